// SPDX-License-Identifier: Apache-2.0
import type { Resizing } from "./sources/source";
import { OBJECT_PLACES, type ObjectRun, type ObjectSample } from "./wire";

/** Points are places here (`left`, `joined`): whoever stands at one, it is one point to whoever looks. */
interface Known extends ObjectSample {
  final: boolean;
}

/** One object's life: where its centre was, and what else its points said together. */
export class ObjectTrack {
  /** As of a Track: it is followed when the run begins anew. */
  waits = false;
  private known: (Known | undefined)[] = []; // from `start` on
  private finals = 0; // so many of them are final
  private joins = new Map<number, number>(); // from which frame on points take part that were placed anew
  /** The name that the user gave it, which its points have too; "": none. */
  given = "";

  constructor(
    readonly id: number,
    /** Its place among the points and objects ever made, which gives it its colour. */
    readonly order: number,
    readonly start: number,
  ) {}

  get name(): string {
    return this.given || `Object ${this.id}`;
  }

  /** The page's id of the object's point at this place: those after its own. */
  pointAt(place: number): number {
    return this.id + 1 + place;
  }

  get end(): number {
    return this.start + this.known.length;
  }

  /** No estimate before this frame will change. */
  get finalEnd(): number {
    return this.start + this.finals;
  }

  has(frame: number): boolean {
    return this.at(frame) !== undefined;
  }

  at(frame: number): Known | undefined {
    return this.known[frame - this.start];
  }

  // Of frames that the object has.
  x(frame: number): number {
    return this.at(frame)!.x;
  }
  y(frame: number): number {
    return this.at(frame)!.y;
  }
  /** The share of it that is in sight. */
  confidence(frame: number): number {
    return this.at(frame)!.visible;
  }
  visible(frame: number): boolean {
    return this.at(frame)!.visible > 0;
  }
  isFinal(frame: number): boolean {
    return this.at(frame)!.final;
  }

  /** The newest frame with an estimate at or before this one; -1: there is none. */
  newest(frame: number): number {
    for (let t = Math.min(frame, this.end - 1); t >= this.start; --t) if (this.has(t)) return t;
    return -1;
  }

  /** Whether a point of its own does not move with it any more, as of this frame or the newest before it. */
  hasLeft(point: number, frame: number): boolean {
    return this.at(this.newest(frame))?.left.some((place) => this.pointAt(place) === point) ?? false;
  }

  /** Takes estimates over. A provisional one never replaces a final one. */
  apply({ firstFrame, samples, finalCount }: ObjectRun): void {
    samples.forEach(({ joined, ...sample }, i) => {
      const at = firstFrame + i - this.start;
      if (at < 0 || (i >= finalCount && this.known[at]?.final)) return;
      for (const point of joined) this.joins.set(point, firstFrame + i);
      const left = sample.left.filter((point) => this.stands(point, firstFrame + i)).map((point) => point % OBJECT_PLACES);
      this.known[at] = { ...sample, left, joined: joined.map((point) => point % OBJECT_PLACES), final: i < finalCount };
    });
    while (this.known[this.finals]?.final) ++this.finals;
  }

  /** The object as it stands, in frames of another size. */
  resized(resizing: Resizing): ObjectTrack {
    const at = (x: number, y: number): [number, number] => [resizing.x(x), resizing.y(y)];
    const object = Object.assign(new ObjectTrack(this.id, this.order, this.start), this);
    object.known = this.known.map((sample) => {
      if (!sample) return undefined;
      const [x, y] = at(sample.x, sample.y);
      return { ...sample, x, y, outline: sample.outline.map((corner) => at(...corner)) };
    });
    return object;
  }

  // Nobody had been placed in this point's place by then.
  private stands(point: number, frame: number): boolean {
    return !((this.joins.get(point + OBJECT_PLACES) ?? Infinity) <= frame);
  }
}
