# SPDX-License-Identifier: Apache-2.0
"""The Grafana dashboard by itself; monitoring_test.py asks its queries."""
import re
import unittest

from dashboard import load_dashboard, panels_by_row, queries


class DashboardTest(unittest.TestCase):
    def setUp(self):
        self.dashboard = load_dashboard()

    def test_panels_have_their_own_number_place_and_description(self):
        panels = self.dashboard["panels"]
        self.assertEqual(len({panel["id"] for panel in panels}), len(panels))
        taken = {}
        for panel in panels:
            place = panel["gridPos"]
            self.assertLessEqual(place["x"] + place["w"], 24, panel["title"])
            for x in range(place["x"], place["x"] + place["w"]):
                for y in range(place["y"], place["y"] + place["h"]):
                    self.assertNotIn((x, y), taken, f"{panel['title']} lies on {taken.get((x, y))}")
                    taken[x, y] = panel["title"]
        for _, panel in panels_by_row(self.dashboard):
            self.assertTrue(panel["description"].endswith("."), panel["title"])
            self.assertTrue(panel["targets"], panel["title"])

    def test_every_data_source_is_the_variable(self):
        def sources(value):
            if isinstance(value, dict):
                if "datasource" in value:
                    yield value["datasource"]
                for item in value.values():
                    yield from sources(item)
            elif isinstance(value, list):
                for item in value:
                    yield from sources(item)

        found = list(sources(self.dashboard))
        self.assertGreater(len(found), 40)
        self.assertTrue(all(source == {"type": "prometheus", "uid": "${datasource}"} for source in found))

    def test_every_variable_in_a_query_is_known(self):
        known = {variable["name"] for variable in self.dashboard["templating"]["list"]}
        for title, expression in queries(self.dashboard, with_training=True):
            for name in re.findall(r"\$(\w+)", expression):
                self.assertIn(name, known | {"__rate_interval"}, title)


if __name__ == "__main__":
    unittest.main(verbosity=2)
