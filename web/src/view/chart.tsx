// SPDX-License-Identifier: Apache-2.0
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import * as page from "../page";

const { tracker } = page;
const HEIGHT = 110; // CSS pixels

function makeChart(host: HTMLElement): uPlot {
  const style = getComputedStyle(host);
  const color = (name: string) => style.getPropertyValue(name).trim();
  const axis = { stroke: color("--text-soft"), font: "11px system-ui, sans-serif", ticks: { show: false } };
  const grid = { stroke: color("--line"), width: 1 };
  return new uPlot(
    {
      width: host.clientWidth,
      height: HEIGHT,
      padding: [8, 6, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: { x: { time: false, range: (_chart, low, high) => (low === null ? [0, 48] : [low, Math.max(high, low + 8)]) }, y: { range: (_chart, _low, high) => [0, Math.max(100, high * 1.1)] } },
      axes: [{ ...axis, size: 22, grid: { show: false } }, { ...axis, size: 44, grid, values: (_chart, ms) => ms.map(inWords) }],
      series: [{}, { stroke: color("--accent"), width: 1.5, fill: color("--accent-faint"), points: { show: false } }],
    },
    [[], []],
    host,
  );
}

const inWords = (ms: number) => (ms >= 1000 ? `${ms / 1000} s` : `${ms} ms`);

/** How long each frame waited for its first estimate. */
export function LatencyChart() {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => {
    let chart: uPlot | null = null;
    const stopTheme = effect(() => {
      void page.theme.value;
      chart?.destroy();
      chart = makeChart(host.current!);
    });
    const stopData = effect(() => {
      void [tracker.revision.value, page.theme.value];
      const { latencies } = tracker.figures;
      chart?.setData([latencies.map(([frame]) => frame), latencies.map(([, ms]) => ms)]);
    });
    const resize = new ResizeObserver(([entry]) => chart?.setSize({ width: entry!.contentRect.width, height: HEIGHT }));
    resize.observe(host.current!);
    return () => {
      resize.disconnect();
      stopTheme();
      stopData();
      chart?.destroy();
    };
  }, []);
  return <div class="chart" ref={host} role="img" aria-label="Latency of the newest frames" />;
}
