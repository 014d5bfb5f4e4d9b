// SPDX-License-Identifier: Apache-2.0

export interface Position {
  x: number;
  y: number;
}

function distanceSquared(p: Position, a: Position, b: Position): number {
  const [dx, dy] = [b.x - a.x, b.y - a.y];
  const length = dx * dx + dy * dy;
  const t = length === 0 ? 0 : Math.min(1, Math.max(0, ((p.x - a.x) * dx + (p.y - a.y) * dy) / length));
  return (p.x - a.x - t * dx) ** 2 + (p.y - a.y - t * dy) ** 2;
}

/** Whether a stroke of this radius covers a position. */
export function covers(stroke: readonly Position[], radius: number, p: Position): boolean {
  return stroke.some((at, i) => distanceSquared(p, stroke[Math.max(0, i - 1)]!, at) <= radius * radius);
}

/**
 * At most `count` positions spread evenly over what a stroke covers of a frame: the points of a triangular lattice whose
 * step makes them so many. A stroke too thin for the lattice gets its own middle.
 */
export function spread(stroke: readonly Position[], radius: number, count: number, width: number, height: number): Position[] {
  const inside = (p: Position) => p.x >= 0 && p.y >= 0 && p.x <= width - 1 && p.y <= height - 1;
  let found: Position[] = [];
  let [low, high] = [2, 2 * Math.max(width, height)]; // the step: more than `count` at low, at most so many at high
  for (let i = 0; i < 24; ++i) {
    const step = (low + high) / 2;
    const here = lattice(stroke, radius, step).filter((p) => inside(p) && covers(stroke, radius, p));
    if (here.length > count) {
      low = step;
    } else {
      high = step;
      if (here.length >= found.length) found = here;
    }
  }
  const middle = stroke[stroke.length >> 1];
  return found.length > 0 || !middle || !inside(middle) ? found : [middle];
}

function lattice(stroke: readonly Position[], radius: number, step: number): Position[] {
  const [xs, ys] = [stroke.map((p) => p.x), stroke.map((p) => p.y)];
  const [left, right] = [Math.min(...xs) - radius, Math.max(...xs) + radius];
  const [top, bottom] = [Math.min(...ys) - radius, Math.max(...ys) + radius];
  const rise = (step * Math.sqrt(3)) / 2;
  const points: Position[] = [];
  for (let row = 0, y = top + rise / 2; y <= bottom; ++row, y += rise) {
    for (let x = left + (row % 2 ? step : step / 2); x <= right; x += step) points.push({ x, y });
  }
  return points;
}

/** About `count` positions in rows over a frame, as `holdfast track --grid` has them. */
export function grid(count: number, width: number, height: number): Position[] {
  const cell = Math.sqrt((width * height) / count);
  const columns = Math.min(Math.max(1, Math.round(width / cell)), count, width);
  const rows = Math.min(Math.max(1, Math.round(count / columns)), height);
  const points: Position[] = [];
  for (let row = 0; row < rows; ++row) {
    for (let column = 0; column < columns; ++column) {
      points.push({ x: ((column + 0.5) * width) / columns - 0.5, y: ((row + 0.5) * height) / rows - 0.5 });
    }
  }
  return points;
}
