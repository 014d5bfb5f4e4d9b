// SPDX-License-Identifier: Apache-2.0
import { create, fromBinary, toBinary, type MessageInitShape } from "@bufbuild/protobuf";
import { TrackRequestSchema, type TrackResponse, TrackResponseSchema } from "../../src/gen/holdfast/v1/point_tracking_pb";
import type { Socket, World } from "../../src/connection";
import { OBJECT_POINTS, type ObjectRun, type Run } from "../../src/wire";

export const response = (value: MessageInitShape<typeof TrackResponseSchema>["response"]): TrackResponse =>
  create(TrackResponseSchema, { response: value });

export const request = (bytes: Uint8Array) => fromBinary(TrackRequestSchema, bytes).request;

/** A short name of what a message says: "config", "frame 3", … */
export function nameOf(bytes: Uint8Array): string {
  const { case: kind, value } = request(bytes);
  return kind === "frame" ? `frame ${value.index}` : String(kind);
}

export const accepted = (more: object = {}) =>
  response({
    case: "accepted",
    value: { hopFrames: 8, windowFrames: 24, iterations: 4, replayFrames: 32, checkpointIntervalFrames: 24, ...more },
  });

/** An id as messages have it. */
export const inMessages = (id: number) => BigInt(id) + (id < OBJECT_POINTS ? 0n : 2n ** 63n);

export const tracks = (framesProcessed: number, runs: Run[] = [], objects: ObjectRun[] = []) =>
  response({
    case: "tracks",
    value: {
      framesReceived: BigInt(framesProcessed),
      framesProcessed: BigInt(framesProcessed),
      runs: runs.map((run) => ({ ...run, id: inMessages(run.id), firstFrame: BigInt(run.firstFrame) })),
      objects: objects.map(({ samples, ...run }) => ({
        ...run,
        firstFrame: BigInt(run.firstFrame),
        samples: samples.map(({ outline, left, joined, ...sample }) => ({
          ...sample,
          outlineX: outline.map(([x]) => x),
          outlineY: outline.map(([, y]) => y),
          left: left.map((i) => inMessages(OBJECT_POINTS * run.id + i)),
          joined: joined.map((i) => inMessages(OBJECT_POINTS * run.id + i)),
        })),
      })),
    },
  });

export const checkpoint = (nextFrame: number, token = "token") =>
  response({
    case: "checkpoint",
    value: { token: new TextEncoder().encode(token), nextFrame: BigInt(nextFrame), resumable: true },
  });

/** A run whose positions are x = frame + offset, y = 2 frame. */
export function run(id: number, firstFrame: number, length: number, finalCount = 0, offset = 0): Run {
  const frames = Array.from({ length }, (_, i) => firstFrame + i);
  return {
    id,
    firstFrame,
    x: frames.map((t) => t + offset),
    y: frames.map((t) => 2 * t),
    visible: frames.map(() => true),
    confidence: frames.map(() => 0.5),
    finalCount,
  };
}

/** An object whose centre is at x = frame + offset, y = 2 frame, of which the points `left` have left; those that `joined` did so on its first frame. */
export function objectRun(
  id: number, firstFrame: number, length: number, finalCount = 0, offset = 0, left: number[] = [], joined: number[] = [],
): ObjectRun {
  const samples = Array.from({ length }, (_, i) => {
    const t = firstFrame + i;
    const outline: [number, number][] = [[t, 1], [t + 4, 1], [t, 8]];
    return { x: t + offset, y: 2 * t, scale: 1, rotation: 0.5, visible: 0.75, outline, left, joined: i === 0 ? joined : [] };
  });
  return { id, firstFrame, samples, finalCount };
}

/** A WebSocket whose other end is the test. */
export class FakeSocket implements Socket {
  binaryType: BinaryType = "blob";
  bufferedAmount = 0;
  onopen: ((event: Event) => void) | null = null;
  onmessage: ((event: MessageEvent) => void) | null = null;
  onclose: ((event: CloseEvent) => void) | null = null;
  sent: Uint8Array[] = [];
  closed = false;

  send(data: Uint8Array): void {
    this.sent.push(data);
  }
  close(): void {
    this.closed = true;
  }

  open(): void {
    this.onopen?.(new Event("open"));
  }
  say(message: TrackResponse): void {
    const bytes = toBinary(TrackResponseSchema, message);
    this.onmessage?.({ data: bytes.slice().buffer } as MessageEvent);
  }
  break(): void {
    this.onclose?.({} as CloseEvent);
  }
  get names(): string[] {
    return this.sent.map(nameOf);
  }
}

/** A world whose time stands still until it is moved on. */
export class FakeWorld implements World {
  sockets: FakeSocket[] = [];
  time = 0;
  away = false;
  private timers: { at: number; call: () => void }[] = [];

  open(): FakeSocket {
    const socket = new FakeSocket();
    this.sockets.push(socket);
    return socket;
  }
  now(): number {
    return this.time;
  }
  random(): number {
    return 0.5;
  }
  refusal(): string {
    return "refused";
  }
  hidden(): boolean {
    return this.away;
  }
  after(ms: number, call: () => void): () => void {
    const timer = { at: this.time + ms, call };
    this.timers.push(timer);
    return () => {
      this.timers = this.timers.filter((other) => other !== timer);
    };
  }

  get socket(): FakeSocket {
    return this.sockets.at(-1)!;
  }
  pass(ms: number): void {
    const end = this.time + ms;
    for (;;) {
      const due = this.timers.filter(({ at }) => at <= end).sort((a, b) => a.at - b.at)[0];
      if (!due) break;
      this.timers = this.timers.filter((other) => other !== due);
      this.time = due.at;
      due.call();
    }
    this.time = end;
  }
}
