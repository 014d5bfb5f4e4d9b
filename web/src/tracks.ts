// SPDX-License-Identifier: Apache-2.0
import { ObjectTrack } from "./objects";
import type { Resizing } from "./sources/source";
import { OBJECT_PLACES, OBJECT_POINTS, type ObjectRun, type Run } from "./wire";

export interface Sample {
  x: number; // pixels
  y: number; // pixels
  confidence: number; // 0 .. 1
  visible: boolean;
  final: boolean;
}

const PRESENT = 1;
const FINAL = 2;
const VISIBLE = 4;

/** One point's life. Plain arrays of numbers, which grow by doubling: thousands of points are drawn from them. */
export class Track {
  /** It is there to be seen, and is followed when the run begins anew: what came of this run says nothing of it. */
  waits = false;
  /** What is before this frame belongs to an earlier beginning of the point, and changes no more. */
  seedFrame: number;
  /** Frames from the first estimate to the newest. */
  length = 0;
  private xs = new Float32Array(64);
  private ys = new Float32Array(64);
  private confidences = new Float32Array(64);
  private flags = new Uint8Array(64);
  private finals = 0; // from seedFrame on, so many are final
  private beginning = 0; // counts those that the server has made
  private given = ""; // a name

  constructor(
    readonly id: number,
    /** The point's place among those ever made, which gives it its colour. */
    readonly order: number,
    public start: number,
    /** Whose point it is; null: the user placed it. */
    readonly object: ObjectTrack | null = null,
  ) {
    this.seedFrame = start;
  }

  /** What the user gave it, or its object; otherwise its id. */
  get name(): string {
    return this.given || this.object?.given || String(this.id);
  }
  set name(given: string) {
    this.given = given;
  }

  get end(): number {
    return this.start + this.length;
  }

  /** No estimate before this frame will change. */
  get finalEnd(): number {
    return this.seedFrame + this.finals;
  }

  has(frame: number): boolean {
    return frame >= this.start && frame < this.end && this.flags[frame - this.start] !== 0;
  }

  // Of frames that the track has.
  x(frame: number): number {
    return this.xs[frame - this.start]!;
  }
  y(frame: number): number {
    return this.ys[frame - this.start]!;
  }
  confidence(frame: number): number {
    return this.confidences[frame - this.start]!;
  }
  visible(frame: number): boolean {
    return (this.flags[frame - this.start]! & VISIBLE) !== 0;
  }
  isFinal(frame: number): boolean {
    return (this.flags[frame - this.start]! & FINAL) !== 0;
  }

  at(frame: number): Sample | null {
    if (!this.has(frame)) return null;
    const [x, y, confidence] = [this.x(frame), this.y(frame), this.confidence(frame)];
    return { x, y, confidence, visible: this.visible(frame), final: this.isFinal(frame) };
  }

  /** The newest frame with an estimate at or before this one; -1: there is none. */
  newest(frame: number): number {
    for (let t = Math.min(frame, this.end - 1); t >= this.start; --t) if (this.has(t)) return t;
    return -1;
  }

  /** The point begins anew on this frame; what was estimated from there on is void. */
  reseed(frame: number): void {
    this.seedFrame = frame;
    this.finals = 0;
    this.length = Math.max(0, Math.min(this.length, frame - this.start));
    if (this.length === 0) this.start = frame;
    this.flags.fill(0, this.length);
  }

  /**
   * Takes estimates over. A provisional one never replaces a final one. A later beginning of the point is one that the
   * server has made: it counts from its first estimate on, and the one before it up to there.
   */
  apply(run: Run, beginning = 0): void {
    const first = run.firstFrame - this.start;
    if (first < 0) return; // from before the point's first seed: never sent by a server
    if (beginning > this.beginning) {
      this.reseed(run.firstFrame);
      this.beginning = beginning;
    }
    const length = beginning < this.beginning ? Math.min(run.x.length, this.seedFrame - run.firstFrame) : run.x.length;
    if (length <= 0) return;
    this.reserve(first + length);
    for (let i = 0; i < length; ++i) {
      const at = first + i;
      const final = i < run.finalCount;
      if (!final && this.flags[at]! & FINAL) continue;
      this.xs[at] = run.x[i]!;
      this.ys[at] = run.y[i]!;
      this.confidences[at] = run.confidence[i]!;
      this.flags[at] = PRESENT | (final ? FINAL : 0) | (run.visible[i] ? VISIBLE : 0);
    }
    this.length = Math.max(this.length, first + length);
    while (this.finalEnd < this.end && this.isFinal(this.finalEnd)) ++this.finals;
  }

  /** The track as it stands, in frames of another size; `object` is whose point it is there. */
  resized(resizing: Resizing, object: ObjectTrack | null): Track {
    const track = Object.assign(new Track(this.id, this.order, this.start), this, { object });
    track.xs = this.xs.map((x) => resizing.x(x));
    track.ys = this.ys.map((y) => resizing.y(y));
    return track;
  }

  private reserve(length: number): void {
    if (length <= this.xs.length) return;
    const size = Math.max(length, 2 * this.xs.length);
    const grown = <T extends Float32Array | Uint8Array>(next: T, old: T): T => (next.set(old), next);
    this.xs = grown(new Float32Array(size), this.xs);
    this.ys = grown(new Float32Array(size), this.ys);
    this.confidences = grown(new Float32Array(size), this.confidences);
    this.flags = grown(new Uint8Array(size), this.flags);
  }
}

// Of an id as it is in messages: how many stood in its place before.
const beginningOf = (id: number) => (id < OBJECT_POINTS ? 0 : Math.floor((id % OBJECT_POINTS) / OBJECT_PLACES));

/** The tracks of a session's points and objects, in the order in which they were made. */
export class TrackStore {
  private byId = new Map<number, Track>();
  private objectsById = new Map<number, ObjectTrack>();
  private made = 0;

  /** Those of points, also of points that objects have. */
  get tracks(): Iterable<Track> {
    return this.byId.values();
  }
  get objects(): Iterable<ObjectTrack> {
    return this.objectsById.values();
  }

  get(id: number): Track | undefined {
    return this.byId.get(id);
  }
  getObject(id: number): ObjectTrack | undefined {
    return this.objectsById.get(id);
  }

  /** A point begins on this frame; a known one anew. */
  seed(id: number, frame: number): Track {
    let track = this.byId.get(id);
    if (track) {
      track.reseed(frame);
    } else {
      track = new Track(id, this.made++, frame);
      this.byId.set(id, track);
    }
    return track;
  }

  /** An object begins on this frame. Its points are there as soon as something is heard of them. */
  seedObject(id: number, frame: number): ObjectTrack {
    const object = new ObjectTrack(id, this.made++, frame);
    this.objectsById.set(id, object);
    return object;
  }

  remove(id: number): void {
    this.byId.delete(id);
    if (!this.objectsById.delete(id)) return;
    for (const track of this.pointsOf(id)) this.byId.delete(track.id);
  }

  pointsOf(object: number): Track[] {
    return [...this.byId.values()].filter((track) => track.object?.id === object);
  }

  /** What was removed meanwhile is passed over. */
  apply(runs: readonly Run[], objects: readonly ObjectRun[] = []): void {
    for (const run of runs) this.trackOf(run.id)?.apply(run, beginningOf(run.id));
    for (const run of objects) this.objectsById.get(run.id)?.apply(run);
  }

  /** Estimates of frames 0 .. this - 1 are final, of so many frames in all. */
  finalFrames(frames: number): number {
    for (const { waits, finalEnd } of [...this.tracks, ...this.objects]) {
      if (!waits) frames = Math.min(frames, finalEnd);
    }
    return frames;
  }

  // Of an id as it is in messages.
  private trackOf(id: number): Track | undefined {
    if (id < OBJECT_POINTS) return this.byId.get(id);
    const object = this.objectsById.get(Math.floor(id / OBJECT_POINTS));
    if (!object) return undefined;
    const point = object.pointAt((id % OBJECT_POINTS) % OBJECT_PLACES);
    const known = this.byId.get(point);
    if (known) return known;
    const track = new Track(point, object.order, object.start, object);
    this.byId.set(point, track);
    return track;
  }
}
