// SPDX-License-Identifier: Apache-2.0
import type { Seed } from "./wire";

/** Where a point was placed by hand. */
export interface Placed {
  frame: number;
  x: number; // pixels of the frames sent
  y: number;
}

/** A point as the user made it: it begins where it was placed first, and anew wherever it was placed again. */
export interface Point {
  id: number;
  name: string;
  placed: Placed[]; // by frame
}

/** What the user asked for, apart from what came of it: a video can be tracked again with it. */
export class Points {
  private byId = new Map<number, Point>();
  private lastId = 0;

  get all(): Iterable<Point> {
    return this.byId.values();
  }
  get size(): number {
    return this.byId.size;
  }

  get(id: number): Point | undefined {
    return this.byId.get(id);
  }

  add(frame: number, x: number, y: number): Point {
    const id = ++this.lastId; // never used again, so that late results of a removed point meet nobody
    const point = { id, name: String(id), placed: [{ frame, x, y }] };
    this.byId.set(id, point);
    return point;
  }

  /** Corrects a point on this frame. */
  place(id: number, frame: number, x: number, y: number): void {
    const point = this.byId.get(id);
    if (!point) return;
    point.placed = [...point.placed.filter((p) => p.frame !== frame), { frame, x, y }].sort((a, b) => a.frame - b.frame);
  }

  remove(id: number): void {
    this.byId.delete(id);
  }

  clear(): void {
    this.byId.clear();
    this.lastId = 0;
  }

  /** What is to be sent with a frame. */
  seedsOn(frame: number): Seed[] {
    const seeds: Seed[] = [];
    for (const { id, placed } of this.byId.values()) {
      const here = placed.find((p) => p.frame === frame);
      if (here) seeds.push({ id, x: here.x, y: here.y });
    }
    return seeds;
  }
}
