// SPDX-License-Identifier: Apache-2.0

const RECENT = 240; // samples that figures are made of
const RATE_MS = 3_000; // over which a rate is taken
const LEAST_RATE_MS = 500; // from which on it says something

/** The q-th quantile (0 .. 1) by nearest rank; NaN of nothing. */
export function quantile(values: readonly number[], q: number): number {
  if (values.length === 0) return NaN;
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[Math.max(0, Math.ceil(q * sorted.length) - 1)]!;
}

/** How fast frames are answered. Times are ms of a steady clock. */
export class Figures {
  /** [frame, ms from sending it to its first estimate], the newest of them. */
  readonly latencies: [number, number][] = [];
  /** [time, frames a second], the newest of them. */
  readonly rates: [number, number][] = [];
  private waiting = new Map<number, number>(); // when a frame was sent that has no estimate yet
  private progress: [number, number][] = []; // [time, frames processed]

  sent(frame: number, now: number): void {
    this.waiting.set(frame, now);
    if (this.waiting.size > 2 * RECENT) this.waiting.delete(this.waiting.keys().next().value!);
  }

  /** An update has estimates of the frames first .. last. */
  answered(first: number, last: number, now: number): void {
    for (const [frame, since] of this.waiting) {
      if (frame > last) break;
      if (frame < first) continue;
      this.waiting.delete(frame);
      this.latencies.push([frame, now - since]);
    }
    if (this.latencies.length > RECENT) this.latencies.splice(0, this.latencies.length - RECENT);
  }

  processed(frames: number, now: number): void {
    if (frames !== this.progress.at(-1)?.[1]) this.progress.push([now, frames]);
    while (this.progress.length > 2 && this.progress[1]![0] < now - RATE_MS) this.progress.shift();
    if (now - this.progress[0]![0] >= LEAST_RATE_MS) this.rates.push([now, this.rate(now)]);
    if (this.rates.length > RECENT) this.rates.shift();
  }

  /** Frames a second, of late. */
  rate(now: number): number {
    const [first, last] = [this.progress[0], this.progress.at(-1)];
    if (!first || !last || first === last || now - last[0] > RATE_MS) return NaN;
    return (1000 * (last[1] - first[1])) / (last[0] - first[0]);
  }

  latency(q: number): number {
    return quantile(this.latencies.map(([, ms]) => ms), q);
  }
}
