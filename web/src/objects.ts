// SPDX-License-Identifier: Apache-2.0
import type { ObjectRun, ObjectSample } from "./wire";

interface Known extends ObjectSample {
  final: boolean;
}

/** One object's life: where its centre was, and what else its points said together. */
export class ObjectTrack {
  private known: (Known | undefined)[] = []; // from `start` on
  private finals = 0; // so many of them are final

  constructor(
    readonly id: number,
    readonly name: string,
    /** Its place among the points and objects ever made, which gives it its colour. */
    readonly order: number,
    readonly start: number,
  ) {}

  /** The page's id of the object's point i: those after its own. */
  pointAt(i: number): number {
    return this.id + 1 + i;
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
    return this.at(this.newest(frame))?.left.some((i) => this.pointAt(i) === point) ?? false;
  }

  /** Takes estimates over. A provisional one never replaces a final one. */
  apply({ firstFrame, samples, finalCount }: ObjectRun): void {
    samples.forEach((sample, i) => {
      const at = firstFrame + i - this.start;
      if (at < 0 || (i >= finalCount && this.known[at]?.final)) return;
      this.known[at] = { ...sample, final: i < finalCount };
    });
    while (this.known[this.finals]?.final) ++this.finals;
  }
}
