// SPDX-License-Identifier: Apache-2.0
import type { ObjectSeed, Seed } from "./wire";

/** Pixels of the frames sent. */
export interface Position {
  x: number;
  y: number;
}

/** Where a point was placed by hand. */
export interface Placed extends Position {
  frame: number;
}

/** A point as the user made it: it begins where it was placed first, and anew wherever it was placed again. */
export interface Point {
  id: number;
  name: string; // "": the user gave none
  placed: Placed[]; // by frame
}

/** What the brush went over. */
export interface Stroke {
  path: readonly Position[];
  radius: number; // pixels of the frames sent
}

/** What a line through its corners encloses. */
export interface Polygon {
  corners: readonly Position[];
}

/** What an object covers. A stroke has a PNG of it besides. */
export type Shape = (Stroke & { mask: Uint8Array }) | Polygon;

/** An object as the user drew it. The `count` ids after its own are those of its points. */
export interface DrawnObject {
  id: number;
  name: string; // "": the user gave none
  frame: number; // that it begins on
  shown: number; // that it was drawn on: `frame`, or one before, where that had been sent
  shape: Shape;
  count: number;
}

/** What the user asked for, apart from what came of it: a video can be tracked again with it. */
export class Points {
  private byId = new Map<number, Point>();
  private objectsById = new Map<number, DrawnObject>();
  private lastId = 0; // ids are never used again, so that late results of what was removed meet nobody

  get all(): Iterable<Point> {
    return this.byId.values();
  }
  get objects(): Iterable<DrawnObject> {
    return this.objectsById.values();
  }
  get size(): number {
    return this.byId.size;
  }
  get objectCount(): number {
    return this.objectsById.size;
  }
  /** Points that there may be, with those of objects. */
  get most(): number {
    return [...this.objects].reduce((sum, { count }) => sum + count, this.size);
  }

  get(id: number): Point | undefined {
    return this.byId.get(id);
  }
  getObject(id: number): DrawnObject | undefined {
    return this.objectsById.get(id);
  }

  add(frame: number, x: number, y: number): Point {
    const id = ++this.lastId;
    const point = { id, name: "", placed: [{ frame, x, y }] };
    this.byId.set(id, point);
    return point;
  }

  addObject(drawn: Omit<DrawnObject, "id" | "name">): DrawnObject {
    const id = ++this.lastId;
    this.lastId += drawn.count;
    const object = { ...drawn, id, name: "" };
    this.objectsById.set(id, object);
    return object;
  }

  /** Corrects a point on this frame. */
  place(id: number, frame: number, x: number, y: number): void {
    const point = this.byId.get(id);
    if (!point) return;
    point.placed = [...point.placed.filter((p) => p.frame !== frame), { frame, x, y }].sort((a, b) => a.frame - b.frame);
  }

  remove(id: number): void {
    this.byId.delete(id);
    this.objectsById.delete(id);
  }

  clear(): void {
    this.byId.clear();
    this.objectsById.clear();
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

  /** What is to be sent with it besides. */
  objectsOn(frame: number): ObjectSeed[] {
    const here = [...this.objects].filter((object) => object.frame === frame);
    return here.map(({ id, shape, count }) => ({ id, shape, points: count }));
  }
}
