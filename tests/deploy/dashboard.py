# SPDX-License-Identifier: Apache-2.0
"""The Grafana dashboard of deploy/, taken apart."""
import json

from tools import DEPLOY

TRAINING_ROW = "Training"


def load_dashboard():
    return json.loads((DEPLOY / "grafana" / "holdfast.json").read_text(encoding="utf-8"))


def panels_by_row(dashboard):
    """(title of the row, panel) of every panel."""
    row = None
    for panel in dashboard["panels"]:
        if panel["type"] == "row":
            row = panel["title"]
        else:
            yield row, panel


def queries(dashboard, with_training):
    """(title, expression) of every query, but those of training where there is none."""
    found = [(panel["title"], target["expr"]) for row, panel in panels_by_row(dashboard) for target in panel["targets"]
             if with_training or row != TRAINING_ROW]
    return found + [(item["name"], item["expr"]) for item in dashboard["annotations"]["list"]]
