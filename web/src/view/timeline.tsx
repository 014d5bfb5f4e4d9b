// SPDX-License-Identifier: Apache-2.0
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { colorOf, confidenceColor } from "../draw";
import { type Lane, shownFrames, type Span, stretches } from "../lanes";
import * as page from "../page";

const { tracker } = page;
const LANE = 18; // CSS pixels
const RULER = 22;
const NAMES = 76; // width of the column of names
const MOST_FRAMES = 1200; // on screen at once

/** A lane a point or object: a bar where it is seen, a line where it is hidden, paler while it may still be revised. */
class TimelineCanvas {
  private readonly context: CanvasRenderingContext2D;
  private readonly stops: (() => void)[] = [];
  private painting = 0;
  private dragging = false;
  private lanes: Lane[] = []; // an object's points have none of their own
  private span: Span = { from: 0, to: 0 }; // as painted last

  constructor(
    private readonly scroller: HTMLElement,
    private readonly canvas: HTMLCanvasElement,
    private readonly spacer: HTMLElement,
  ) {
    this.context = canvas.getContext("2d")!;
    const resize = new ResizeObserver(() => this.paintSoon());
    resize.observe(scroller);
    this.stops.push(() => resize.disconnect());
    this.stops.push(effect(() => this.repaintFor(tracker.revision.value, tracker.shown.value, tracker.there.value,
      page.selected.value, page.hovered.value, page.theme.value, page.settings.value.confidence)));
    const on = <K extends keyof HTMLElementEventMap>(target: HTMLElement, type: K, call: (event: HTMLElementEventMap[K]) => void) => {
      target.addEventListener(type, call);
      this.stops.push(() => target.removeEventListener(type, call));
    };
    on(scroller, "scroll", () => this.paintSoon());
    on(canvas, "pointerdown", (event) => this.press(event));
    on(canvas, "pointermove", (event) => this.move(event));
    on(canvas, "pointerup", () => (this.dragging = false));
    on(canvas, "pointerleave", () => (page.hovered.value = null));
    this.stops.push(effect(() => this.scrollTo(page.selected.value)));
  }

  close(): void {
    cancelAnimationFrame(this.painting);
    for (const stop of this.stops) stop();
  }

  private repaintFor(..._reasons: unknown[]): void {
    this.paintSoon();
  }

  private paintSoon(): void {
    cancelAnimationFrame(this.painting);
    this.painting = requestAnimationFrame(() => this.paint());
  }

  private scrollTo(id: number | null): void {
    const row = this.lanes.findIndex((track) => track.id === id);
    if (row < 0) return;
    const [top, room] = [row * LANE, this.scroller.clientHeight - RULER];
    if (top < this.scroller.scrollTop) this.scroller.scrollTop = top;
    if (top + LANE > this.scroller.scrollTop + room) this.scroller.scrollTop = top + LANE - room;
  }

  // --- Frames and rows against places on the canvas, in CSS pixels.

  private nextSpan(): Span {
    const expected = typeof tracker.source.value?.frames === "number" ? tracker.expected.value : null;
    return shownFrames(tracker.there.value, expected, MOST_FRAMES, tracker.shown.value, this.span.from);
  }
  private xOf(frame: number): number {
    const { from, to } = this.span;
    return NAMES + ((frame - from) * (this.scroller.clientWidth - NAMES - 8)) / (to - from + 1);
  }
  private frameAt(x: number): number {
    const { from, to } = this.span;
    return from + Math.floor(((x - NAMES) * (to - from + 1)) / (this.scroller.clientWidth - NAMES - 8));
  }
  private laneAt(y: number): Lane | undefined {
    return y < RULER ? undefined : this.lanes[Math.floor((y - RULER + this.scroller.scrollTop) / LANE)];
  }

  // --- Painting.

  private paint(): void {
    const { clientWidth: width, clientHeight: height } = this.scroller;
    const { tracks, objects } = tracker.tracks;
    this.span = this.nextSpan();
    this.lanes = [...[...tracks].filter((track) => !track.object), ...objects].sort((a, b) => a.order - b.order);
    this.spacer.style.height = `${Math.max(0, RULER + this.lanes.length * LANE - height)}px`;
    Object.assign(this.canvas.style, { width: `${width}px`, height: `${height}px` });
    Object.assign(this.canvas, { width: Math.round(width * devicePixelRatio), height: Math.round(height * devicePixelRatio) });
    this.context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    const colors = getComputedStyle(this.canvas);
    const color = (name: string) => colors.getPropertyValue(name).trim();
    if (this.lanes.length === 0) this.paintEmpty(width, height, color("--text-soft"));
    this.paintLanes(height, color);
    this.paintRuler(width, color);
    this.paintPlayhead(height, color);
  }

  private paintEmpty(width: number, height: number, textColor: string): void {
    this.context.fillStyle = textColor;
    this.context.font = "13px system-ui, sans-serif";
    this.context.textAlign = "center";
    this.context.textBaseline = "middle";
    this.context.fillText("Points and objects have their lanes here", width / 2, (RULER + height) / 2, width - 24);
    this.context.textAlign = "left";
  }

  private paintLanes(height: number, color: (name: string) => string): void {
    const { context, scroller } = this;
    const first = Math.floor(scroller.scrollTop / LANE);
    const last = Math.min(this.lanes.length - 1, Math.floor((scroller.scrollTop + height - RULER) / LANE));
    for (let row = first; row <= last; ++row) {
      const track = this.lanes[row]!;
      const y = RULER + row * LANE - scroller.scrollTop;
      const chosen = track.id === page.selected.value;
      if (chosen || track.id === page.hovered.value) {
        context.fillStyle = color(chosen ? "--lane-selected" : "--lane-hovered");
        context.fillRect(0, y, scroller.clientWidth, LANE);
      }
      this.paintName(track, y, color(chosen ? "--text" : "--text-soft"));
      this.paintStretches(track, y);
      this.paintPlaced(track, y, color("--text"));
    }
  }

  private paintName(track: Lane, y: number, textColor: string): void {
    const { context } = this;
    context.fillStyle = colorOf(track);
    context.beginPath();
    if (tracker.points.getObject(track.id)) context.roundRect(9, y + LANE / 2 - 5, 10, 10, 3);
    else context.arc(14, y + LANE / 2, 4, 0, 2 * Math.PI);
    context.fill();
    context.fillStyle = textColor;
    context.font = "500 11.5px system-ui, sans-serif";
    context.textBaseline = "middle";
    context.fillText(track.name, 24, y + LANE / 2 + 0.5, NAMES - 30);
  }

  private paintStretches(track: Lane, y: number): void {
    const { context } = this;
    const { from, to } = this.span;
    const byConfidence = page.settings.value.confidence;
    for (const { first, last, visible, final } of stretches(track, from, to)) {
      const height = visible ? 8 : 2;
      context.globalAlpha = final ? 1 : 0.45;
      for (let t = first; t <= last; t = byConfidence ? t + 1 : last + 1) {
        const end = byConfidence ? t : last;
        context.fillStyle = byConfidence ? confidenceColor(track.confidence(t)) : colorOf(track);
        const left = Math.round(this.xOf(t) * devicePixelRatio) / devicePixelRatio; // on whole pixels there are no seams
        const right = Math.round(this.xOf(end + 1) * devicePixelRatio) / devicePixelRatio;
        context.fillRect(left, y + (LANE - height) / 2, right - left, height);
      }
    }
    context.globalAlpha = 1;
  }

  private paintPlaced(track: Lane, y: number, color: string): void {
    const { context } = this;
    const drawn = tracker.points.getObject(track.id);
    for (const { frame } of drawn ? [drawn] : (tracker.points.get(track.id)?.placed ?? [])) {
      if (frame < this.span.from || frame > this.span.to) continue;
      const [x, middle] = [(this.xOf(frame) + this.xOf(frame + 1)) / 2, y + LANE / 2];
      context.beginPath();
      for (const [dx, dy] of [[0, -5], [5, 0], [0, 5], [-5, 0]] as const) context.lineTo(x + dx, middle + dy);
      context.closePath();
      context.fillStyle = color;
      context.fill();
    }
  }

  private paintRuler(width: number, color: (name: string) => string): void {
    const { context } = this;
    const { from, to } = this.span;
    context.fillStyle = color("--surface");
    context.fillRect(0, 0, width, RULER);
    context.fillStyle = color("--line");
    context.fillRect(0, RULER - 1, width, 1);
    const widthTo = (frame: number) => this.xOf(Math.min(Math.max(from, frame), to + 1)) - this.xOf(from);
    context.fillStyle = color("--accent-soft");
    context.fillRect(this.xOf(from), RULER - 3, widthTo(tracker.sent.value), 3);
    context.fillStyle = color("--accent");
    context.fillRect(this.xOf(from), RULER - 3, widthTo(tracker.final.value), 3);
    context.fillStyle = color("--text-soft");
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "middle";
    const step = this.tickStep(to - from + 1, width - NAMES);
    for (let t = Math.ceil(from / step) * step; t <= to; t += step) context.fillText(String(t), this.xOf(t), RULER / 2 - 1.5);
  }

  private tickStep(frames: number, width: number): number {
    const wanted = frames / Math.max(1, width / 56);
    return [1, 2, 5, 10, 20, 24, 50, 100, 200, 500, 1000].find((step) => step >= wanted) ?? 2000;
  }

  private paintPlayhead(height: number, color: (name: string) => string): void {
    const shown = tracker.shown.value;
    if (shown < this.span.from) return;
    const [x, next] = [this.xOf(shown), this.xOf(shown + 1)];
    this.context.fillStyle = color("--playhead");
    this.context.fillRect((x + next) / 2 - 0.75, 0, 1.5, height);
    this.context.beginPath();
    this.context.roundRect((x + next) / 2 - 4, 0, 8, 9, [2, 2, 4, 4]);
    this.context.fill();
  }

  // --- Gestures.

  private press(event: PointerEvent): void {
    const track = this.laneAt(event.offsetY);
    if (track) page.selected.value = track.id;
    if (event.offsetX < NAMES) return;
    this.dragging = true;
    this.canvas.setPointerCapture(event.pointerId);
    tracker.show(this.frameAt(event.offsetX));
  }

  private move(event: PointerEvent): void {
    if (this.dragging) tracker.show(this.frameAt(event.offsetX));
    else page.hovered.value = this.laneAt(event.offsetY)?.id ?? null;
  }
}

export function Timeline() {
  const scroller = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const spacer = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const timeline = new TimelineCanvas(scroller.current!, canvas.current!, spacer.current!);
    return () => timeline.close();
  }, []);
  const frames = Math.max(1, tracker.there.value);
  return (
    <div class="timeline" ref={scroller} role="slider" tabIndex={0} aria-label="Frame shown" aria-valuemin={0} aria-valuemax={frames - 1} aria-valuenow={Math.max(0, tracker.shown.value)}>
      <canvas ref={canvas} />
      <div ref={spacer} />
    </div>
  );
}
