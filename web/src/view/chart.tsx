// SPDX-License-Identifier: Apache-2.0
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import * as page from "../page";

const { tracker, server } = page;
const HEIGHT = 110; // CSS pixels
const SPARK_HEIGHT = 26;
const RATE_SECONDS = 15; // at most; a line begins with a third of them
const LOAD_SECONDS = 60;

type Style = (name: string) => string; // a custom property of the page's style

/** A place on the page that holds a chart: in the page's colours, as wide as the place, with the newest data. */
function useChart(height: number, options: (style: Style) => Partial<uPlot.Options>, data: () => uPlot.AlignedData) {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const place = host.current!;
    let chart: uPlot | null = null;
    const stopTheme = effect(() => {
      void page.theme.value;
      chart?.destroy();
      const style = getComputedStyle(place);
      const plain = { width: place.clientWidth, height, legend: { show: false }, cursor: { show: false }, series: [] };
      chart = new uPlot({ ...plain, ...options((name) => style.getPropertyValue(name).trim()) }, [[], []], place);
    });
    const stopData = effect(() => {
      void page.theme.value;
      chart?.setData(data());
    });
    const resize = new ResizeObserver(([entry]) => chart?.setSize({ width: entry!.contentRect.width, height }));
    resize.observe(place);
    return () => {
      resize.disconnect();
      stopTheme();
      stopData();
      chart?.destroy();
    };
  }, []);
  return host;
}

const line = (style: Style) => ({ stroke: style("--accent"), width: 1.5, fill: style("--accent-faint"), points: { show: false } });

const inWords = (ms: number) => (ms >= 1000 ? `${ms / 1000} s` : `${ms} ms`);

function latencyOptions(style: Style): Partial<uPlot.Options> {
  const axis = { stroke: style("--text-soft"), font: "11px system-ui, sans-serif", ticks: { show: false } };
  const grid = { stroke: style("--line"), width: 1 };
  return {
    padding: [8, 6, 0, 0],
    scales: { x: { time: false, range: (_chart, low, high) => (low === null ? [0, 48] : [low, Math.max(high, low + 8)]) }, y: { range: (_chart, _low, high) => [0, Math.max(100, high * 1.1)] } },
    axes: [{ ...axis, size: 22, grid: { show: false } }, { ...axis, size: 44, grid, values: (_chart, ms) => ms.map(inWords) }],
    series: [{}, line(style)],
  };
}

/** How long each frame waited for its first estimate. */
export function LatencyChart() {
  const host = useChart(HEIGHT, latencyOptions, () => {
    void tracker.revision.value;
    const { latencies } = tracker.figures;
    return [latencies.map(([frame]) => frame), latencies.map(([, ms]) => ms)];
  });
  return <div class="chart" ref={host} role="img" aria-label="Latency of the newest frames" />;
}

type Range = (low: number, high: number) => [number, number];

/** A line without axes. */
const sparkline = (range: Range) => (style: Style): Partial<uPlot.Options> => ({
  padding: [2, 0, 2, 0],
  scales: { x: { time: false, range: (_chart, low, high) => range(low ?? 0, high ?? 0) }, y: { range: (_chart, _low, high) => [0, Math.max(1, 1.1 * high)] } },
  axes: [{ show: false }, { show: false }],
  series: [{}, line(style)],
});

/** How many frames a second the server works off. */
export function RateChart() {
  const newest: Range = (low, high) => [Math.max(low, high - RATE_SECONDS), Math.max(high, low + RATE_SECONDS / 3)];
  const host = useChart(SPARK_HEIGHT, sparkline(newest), () => {
    void tracker.revision.value;
    const { rates } = tracker.figures;
    return [rates.map(([time]) => time / 1000), rates.map(([, rate]) => rate)];
  });
  return <div class="load" ref={host} role="img" aria-label={`Frames a second, over the last ${RATE_SECONDS} seconds of the run`} />;
}

/** What the server has to do for all of its clients: points followed over the last minute. */
export function LoadChart() {
  const host = useChart(SPARK_HEIGHT, sparkline((_low, high) => [high - LOAD_SECONDS, high]), () => {
    const loads = server.loads.value;
    return [loads.map(({ seconds }) => seconds), loads.map(({ points }) => points)];
  });
  const now = server.loads.value.at(-1);
  const words = now ? `${now.sessions} ${now.sessions === 1 ? "session" : "sessions"}, ${now.points} points` : "";
  return (
    <>
      <div class="load" ref={host} role="img" aria-label="Points that the server follows, over the last minute" />
      <span class="load-now">{words}</span>
    </>
  );
}
