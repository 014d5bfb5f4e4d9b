// SPDX-License-Identifier: Apache-2.0
import { type ReadonlySignal, type Signal, signal } from "@preact/signals";
import type { World } from "./connection";
import type { FrameStore } from "./frames";

const LEAST_MS = 4; // between two frames

/** Shows the frames that there are, one after the other, as far apart as they came. */
export class Playback {
  private readonly on = signal(false);
  readonly playing: ReadonlySignal<boolean> = this.on;

  constructor(
    private readonly frames: FrameStore,
    private readonly shown: Signal<number>,
    /** Frames that there are to see. */
    private readonly there: ReadonlySignal<number>,
    private readonly world: World,
  ) {}

  /** From the end it begins anew. */
  toggle(): void {
    if (this.on.value) return this.stop();
    if (this.shown.value >= this.there.value - 1) this.shown.value = this.frames.first;
    this.on.value = true;
    this.showNextAfter(this.shown.value);
  }

  stop(): void {
    this.on.value = false;
  }

  private showNextAfter(frame: number): void {
    if (!this.on.value || this.shown.value !== frame) return;
    if (frame + 1 >= this.there.value) return this.stop();
    const ms = 1000 * (this.frames.seconds(frame + 1) - this.frames.seconds(frame));
    this.world.after(Math.max(LEAST_MS, ms), () => {
      if (!this.on.value || this.shown.value !== frame) return;
      this.shown.value = frame + 1;
      this.showNextAfter(frame + 1);
    });
  }
}
