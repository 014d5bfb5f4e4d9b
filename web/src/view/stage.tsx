// SPDX-License-Identifier: Apache-2.0
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { colorOf, type Look, paintOutlining, paintPlaced, paintScene, paintShape, paintStroke } from "../draw";
import type { Lane } from "../lanes";
import * as page from "../page";
import type { DrawnObject, Position } from "../points";
import { clickAt, middleOf } from "../polygon";

const { tracker } = page;
const REACH = 14; // CSS pixels around a point within which it is meant
const MOVE = 4; // CSS pixels from which on a press is a drag
const MOST_ZOOM = 12;
const DRAWN = "#5eead4"; // what is being drawn

/** What the pointer is doing. */
type Gesture =
  | { kind: "none" }
  | { kind: "press"; id: number | null; from: Position } // on a point, or beside all
  | { kind: "drag"; id: number }
  | { kind: "stroke"; path: Position[] }
  | { kind: "corner" } // of an outline, where the button is let go
  | { kind: "pan"; last: Position };

const holdOf = ({ shape }: DrawnObject) => ("path" in shape ? shape.path[shape.path.length >> 1]! : middleOf(shape.corners));

/** The picture with everything on it. Positions are pixels of the frame, unless they are said to be on the canvas. */
class StageCanvas {
  private readonly context: CanvasRenderingContext2D;
  private readonly picture = document.createElement("canvas"); // the frame that is shown
  private readonly stops: (() => void)[] = [];
  private gesture: Gesture = { kind: "none" };
  private pointer: Position | null = null; // where it is, or the crosshair of the arrow keys
  private crosshair = false;
  private zoom = 1;
  private center: Position = { x: 0.5, y: 0.5 }; // of what is seen, as shares of the frame
  private painting = 0;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d")!;
    const resize = new ResizeObserver(() => this.fit());
    resize.observe(canvas);
    this.stops.push(() => resize.disconnect());
    this.stops.push(effect(() => void this.showFrame(tracker.shown.value)));
    this.stops.push(effect(() => this.repaintFor(tracker.revision.value, page.selected.value, page.hovered.value,
      page.settings.value, page.tool.value, page.brushRadius.value, page.corners.value)));
    this.stops.push(effect(() => this.showWhole(page.zoomReset.value, tracker.source.value)));
    this.listen();
  }

  close(): void {
    cancelAnimationFrame(this.painting);
    for (const stop of this.stops) stop();
  }

  // --- Painting.

  private async showFrame(frame: number): Promise<void> {
    if (frame < 0) return;
    const bitmap = await tracker.frames.bitmap(frame);
    if (!bitmap || tracker.shown.value !== frame) return;
    if (this.picture.width !== bitmap.width || this.picture.height !== bitmap.height) {
      Object.assign(this.picture, { width: bitmap.width, height: bitmap.height });
    }
    this.picture.getContext("2d", { alpha: false })!.drawImage(bitmap, 0, 0);
    this.canvas.dataset.frame = String(frame);
    this.paintSoon();
  }

  private repaintFor(..._reasons: unknown[]): void {
    this.paintSoon();
  }

  private showWhole(..._reasons: unknown[]): void {
    this.zoom = 1;
    this.center = { x: 0.5, y: 0.5 };
    this.paintSoon();
  }

  private fit(): void {
    const { clientWidth, clientHeight } = this.canvas;
    const width = Math.round(clientWidth * devicePixelRatio);
    const height = Math.round(clientHeight * devicePixelRatio);
    if (this.canvas.width === width && this.canvas.height === height) return;
    Object.assign(this.canvas, { width, height });
    this.paint(); // at once: resizing has cleared it
  }

  private paintSoon(): void {
    cancelAnimationFrame(this.painting);
    this.painting = requestAnimationFrame(() => this.paint());
  }

  private paint(): void {
    const { context, canvas, picture } = this;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    if (!tracker.source.value || tracker.shown.value < 0) return;
    const { scale, left, top } = this.view();
    context.setTransform(1, 0, 0, 1, left, top);
    context.imageSmoothingEnabled = scale < 4;
    context.imageSmoothingQuality = "high";
    context.drawImage(picture, 0, 0, picture.width * scale, picture.height * scale);
    const { trail, confidence } = page.settings.value;
    const [selected, hovered] = [page.selected.value, page.hovered.value];
    const look: Look = { scale, unit: devicePixelRatio, trail, confidence, selected, hovered };
    const tracks = this.gesture.kind === "drag" ? this.tracksWithout(this.gesture.id) : tracker.tracks.tracks;
    paintScene(context, { tracks, objects: tracker.tracks.objects }, tracker.shown.value, look);
    this.paintPlaced(look);
    this.paintGesture(look);
  }

  private *tracksWithout(id: number) {
    for (const track of tracker.tracks.tracks) if (track.id !== id) yield track;
  }

  // What was asked for, where nothing came of it yet.
  private paintPlaced(look: Look): void {
    for (const { id, placed } of tracker.points.all) {
      const track = tracker.tracks.get(id);
      const here = placed.find(({ frame }) => frame === tracker.shown.value);
      if (track && here && track.newest(here.frame) < 0) paintPlaced(this.context, here.x, here.y, colorOf(track), look);
    }
    for (const { id, shape, shown, frame } of tracker.points.objects) {
      const [object, now] = [tracker.tracks.getObject(id), tracker.shown.value];
      if (object && now >= shown && now <= frame && object.newest(now) < 0) {
        paintShape(this.context, shape, colorOf(object), look);
      }
    }
  }

  private paintGesture(look: Look): void {
    const { context, gesture, pointer } = this;
    const at = (p: Position): [number, number] => [(p.x + 0.5) * look.scale, (p.y + 0.5) * look.scale];
    if (gesture.kind === "drag" && pointer) {
      const track = tracker.tracks.get(gesture.id);
      if (track) paintPlaced(context, pointer.x, pointer.y, colorOf(track), look);
    }
    if (gesture.kind === "stroke") {
      paintStroke(context, { path: gesture.path, radius: page.brushRadius.value }, DRAWN, look);
    }
    const corners = page.corners.value;
    if (corners.length > 0) {
      const closes = pointer !== null && clickAt(corners, pointer, this.cornerReach()) === "close";
      paintOutlining(context, corners, pointer, closes, DRAWN, look);
    }
    if (pointer && page.tool.value === "brush" && gesture.kind !== "drag") {
      context.beginPath();
      context.arc(...at(pointer), page.brushRadius.value * look.scale, 0, 2 * Math.PI);
      context.lineWidth = 1.5 * look.unit;
      context.strokeStyle = "#fff";
      context.stroke();
    }
    if (pointer && this.crosshair) this.paintCrosshair(...at(pointer), look.unit);
  }

  private paintCrosshair(x: number, y: number, unit: number): void {
    const { context } = this;
    for (const [style, width] of [["rgb(10 14 20 / 0.8)", 4], ["#fff", 1.6]] as const) {
      context.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
        context.moveTo(x + 4 * unit * dx, y + 4 * unit * dy);
        context.lineTo(x + 14 * unit * dx, y + 14 * unit * dy);
      }
      context.strokeStyle = style;
      context.lineWidth = width * unit;
      context.stroke();
    }
  }

  // --- From the canvas to the frame.

  /** Canvas pixels per pixel of the frame, and where the frame's corner lies on the canvas. */
  private view(): { scale: number; left: number; top: number } {
    const { width, height } = tracker.source.value!;
    const [across, down] = [this.canvas.width, this.canvas.height];
    const scale = Math.min(across / width, down / height) * this.zoom;
    const place = (side: number, room: number, center: number) =>
      side * scale <= room ? (room - side * scale) / 2
        : Math.min(0, Math.max(room - side * scale, room / 2 - center * side * scale));
    return { scale, left: place(width, across, this.center.x), top: place(height, down, this.center.y) };
  }

  private positionOf(event: MouseEvent): Position {
    const box = this.canvas.getBoundingClientRect();
    const { scale, left, top } = this.view();
    const { width, height } = this.canvas; // whole pixels, which the box on the page need not have
    const along = (share: number, pixels: number, offset: number) => (share * pixels - offset) / scale - 0.5;
    const [across, down] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    return { x: along(across, width, left), y: along(down, height, top) };
  }

  private isInside({ x, y }: Position): boolean {
    const { width, height } = tracker.source.value!;
    return x >= -0.5 && y >= -0.5 && x < width - 0.5 && y < height - 0.5;
  }

  /** CSS pixels as pixels of the frame. */
  private reach(pixels: number): number {
    return (pixels * devicePixelRatio) / this.view().scale;
  }

  private cornerReach() {
    return { first: this.reach(REACH), last: this.reach(MOVE) };
  }

  /** The point, or the object by its centre, that is meant at a position. */
  private nearest(p: Position): number | null {
    let [best, bestSquare] = [null as number | null, this.reach(REACH) ** 2];
    for (const [id, at] of this.places()) {
      const square = (at.x - p.x) ** 2 + (at.y - p.y) ** 2;
      if (square < bestSquare) [best, bestSquare] = [id, square];
    }
    return best;
  }

  // Where points and objects are, or were placed.
  private *places(): Generator<[number, Position]> {
    const shown = tracker.shown.value;
    const known = (track: Lane) => (track.newest(shown) < 0 ? null : { x: track.x(track.newest(shown)), y: track.y(track.newest(shown)) });
    for (const track of tracker.tracks.tracks) {
      if (track.object) continue; // meant by the object's centre
      const at = known(track) ?? tracker.points.get(track.id)?.placed.find(({ frame }) => frame === shown);
      if (at) yield [track.id, at];
    }
    for (const object of tracker.tracks.objects) {
      const drawn = tracker.points.getObject(object.id);
      const at = known(object) ?? (drawn && drawn.shown <= shown && shown <= drawn.frame ? holdOf(drawn) : null);
      if (at) yield [object.id, at];
    }
  }

  // --- Gestures.

  private listen(): void {
    const on = <K extends keyof HTMLElementEventMap>(type: K, call: (event: HTMLElementEventMap[K]) => void) => {
      const guarded = (event: HTMLElementEventMap[K]) => {
        if (tracker.source.value && tracker.shown.value >= 0) call(event);
      };
      this.canvas.addEventListener(type, guarded, { passive: false });
      this.stops.push(() => this.canvas.removeEventListener(type, guarded));
    };
    on("mousedown", (event) => {
      event.preventDefault(); // the ring of the focus is for those who came by key
      (document.activeElement as HTMLElement | null)?.blur();
    });
    on("pointerdown", (event) => this.press(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.release(event));
    on("pointercancel", () => this.rest());
    on("pointerleave", () => this.leave());
    on("contextmenu", (event) => this.menu(event));
    on("wheel", (event) => this.wheel(event));
    on("keydown", (event) => this.key(event));
    on("blur", () => this.leave());
  }

  private press(event: PointerEvent): void {
    const at = this.positionOf(event);
    this.crosshair = false;
    this.pointer = at;
    if (event.button === 1) {
      event.preventDefault();
      this.gesture = { kind: "pan", last: { x: event.clientX, y: event.clientY } };
    } else if (event.button === 0) {
      this.gesture = this.begun(at, event.shiftKey ? "brush" : page.tool.value);
      page.stroking.value = this.gesture.kind === "stroke";
    }
    if (this.gesture.kind !== "none") this.canvas.setPointerCapture(event.pointerId);
    this.paintSoon();
  }

  private begun(at: Position, tool: page.Tool): Gesture {
    if (tool === "outline") return { kind: "corner" }; // also beside the picture: its edge is meant
    if (!this.isInside(at)) return { kind: "none" };
    if (tool === "brush") return { kind: "stroke", path: [at] };
    const id = this.nearest(at);
    if (id !== null) page.selected.value = id;
    return { kind: "press", id, from: at };
  }

  private move(event: PointerEvent): void {
    const at = this.positionOf(event);
    const { gesture } = this;
    this.crosshair = false;
    this.pointer = at;
    if (gesture.kind === "press" && gesture.id !== null && tracker.points.get(gesture.id) && this.isAway(gesture.from, at)) {
      this.gesture = { kind: "drag", id: gesture.id };
    } else if (gesture.kind === "stroke" && Math.hypot(at.x - gesture.path.at(-1)!.x, at.y - gesture.path.at(-1)!.y) > 2) {
      gesture.path.push(at);
    } else if (gesture.kind === "pan") {
      this.pan(event.clientX - gesture.last.x, event.clientY - gesture.last.y);
      gesture.last = { x: event.clientX, y: event.clientY };
    } else if (gesture.kind === "none") {
      page.hovered.value = page.tool.value === "point" ? this.nearest(at) : null;
    }
    if (gesture.kind !== "none" || page.tool.value !== "point") this.paintSoon();
  }

  private release(event: PointerEvent): void {
    const { gesture } = this;
    const at = this.positionOf(event);
    this.rest();
    if (gesture.kind === "press" && gesture.id === null && !this.isAway(gesture.from, at)) {
      page.selected.value = tracker.add([at])[0] ?? null;
    } else if (gesture.kind === "drag" && this.isInside(at)) {
      tracker.place(gesture.id, at);
    } else if (gesture.kind === "stroke") {
      void page.addObject(gesture.path);
    } else if (gesture.kind === "corner") {
      page.clickOutline(at, this.cornerReach());
    }
  }

  private isAway(from: Position, to: Position): boolean {
    return Math.hypot(to.x - from.x, to.y - from.y) > this.reach(MOVE);
  }

  private rest(): void {
    this.gesture = { kind: "none" };
    page.stroking.value = false;
    this.paintSoon();
  }

  private leave(): void {
    if (this.gesture.kind !== "none") return;
    this.pointer = page.hovered.value = null;
    this.crosshair = false;
    this.paintSoon();
  }

  // A right click removes what it meets. So is a finger announced that rests on the screen, which is to remove nothing.
  private menu(event: MouseEvent): void {
    event.preventDefault();
    const touch = (event as Partial<PointerEvent>).pointerType === "touch"; // not every browser says
    const amid = this.gesture.kind !== "none" && !event.ctrlKey; // with Ctrl, a Mac's left button is the right one
    if (!touch && !amid) this.removeAt(this.positionOf(event));
  }

  private removeAt(at: Position): void {
    const id = this.nearest(at);
    if (page.corners.value.length > 0) page.takeCornerBack();
    else if (id !== null) page.remove(id);
    this.rest();
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const at = this.positionOf(event);
    const { width, height } = tracker.source.value!;
    const before = this.zoom;
    this.zoom = Math.min(MOST_ZOOM, Math.max(1, this.zoom * 1.0015 ** -event.deltaY));
    const towards = 1 - before / this.zoom; // what is under the pointer stays there
    this.center.x += ((at.x + 0.5) / width - this.center.x) * towards;
    this.center.y += ((at.y + 0.5) / height - this.center.y) * towards;
    this.paintSoon();
  }

  private pan(dx: number, dy: number): void {
    const { width, height } = tracker.source.value!;
    const { scale } = this.view();
    this.center.x -= (dx * devicePixelRatio) / scale / width;
    this.center.y -= (dy * devicePixelRatio) / scale / height;
    this.paintSoon();
  }

  // The arrow keys move a crosshair while the stage has the focus; Enter is a click there.
  private key(event: KeyboardEvent): void {
    const direction = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const { width, height } = tracker.source.value!;
    const at = this.pointer ?? { x: (width - 1) / 2, y: (height - 1) / 2 };
    if (direction) {
      const step = event.shiftKey ? 1 : 10;
      const moved = { x: at.x + step * direction[0]!, y: at.y + step * direction[1]! };
      this.pointer = { x: Math.min(Math.max(moved.x, 0), width - 1), y: Math.min(Math.max(moved.y, 0), height - 1) };
      this.crosshair = true;
      page.hovered.value = this.nearest(this.pointer);
    } else if (event.key === "Enter" && page.tool.value === "brush") {
      void page.addObject([at]);
    } else if (event.key === "Enter" && page.tool.value === "outline") {
      page.clickOutline(at, this.cornerReach());
    } else if (event.key === "Enter") {
      const id = this.nearest(at);
      page.selected.value = id ?? tracker.add([at])[0] ?? null;
    } else {
      return;
    }
    event.preventDefault();
    this.paintSoon();
  }
}

const ENTER: Record<page.Tool, string> = {
  point: "places a point there",
  brush: "places an object there",
  outline: "places a corner there, and again at the same place closes the outline",
};

export function Stage() {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const stage = new StageCanvas(canvas.current!);
    return () => stage.close();
  }, []);
  const [points, objects] = (tracker.revision.value, [tracker.points.size, tracker.points.objectCount]);
  const name = `Frame ${tracker.shown.value}, ${points} points, ${objects} objects. Arrow keys move a crosshair, Enter ${ENTER[page.tool.value]}.`;
  return <canvas ref={canvas} class={`stage-canvas ${page.tool.value}`} tabIndex={0} role="application" aria-label={name} />;
}
