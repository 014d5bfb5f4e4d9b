// SPDX-License-Identifier: Apache-2.0
// The protocol's messages, to and from the page's own plain values. Ids are numbers here: the page chooses those of points
// and objects, from 1 on. Point i of an object has OBJECT_POINTS * object + i, which is the server's id less 2^63.
import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import { anyUnpack } from "@bufbuild/protobuf/wkt";
import { BadRequestSchema, RetryInfoSchema } from "./gen/google/rpc/error_details_pb";
import type { Status } from "./gen/google/rpc/status_pb";
import {
  type ObjectRun as ObjectRunMessage,
  type PointRun,
  type SessionAccepted,
  type SessionConfig,
  SessionConfigSchema,
  TrackRequestSchema,
  type TrackResponse,
  TrackResponseSchema,
  type Tracks,
} from "./gen/holdfast/v1/point_tracking_pb";

export type { SessionAccepted, SessionConfig, TrackResponse, Tracks };

/** Canonical codes that the page tells apart. */
export const Code = {
  DEADLINE_EXCEEDED: 4,
  RESOURCE_EXHAUSTED: 8,
  FAILED_PRECONDITION: 9,
  INTERNAL: 13,
  UNAVAILABLE: 14,
  UNAUTHENTICATED: 16,
} as const;

/** Where a point begins: pixels of the frames sent, (0, 0) is the centre of the first pixel. */
export interface Seed {
  id: number;
  x: number;
  y: number;
}

/** What is to be followed as a group. */
export interface ObjectSeed {
  id: number;
  /** A PNG of the frame's size, black where the object is not; or the corners of a polygon, in pixels of it. */
  shape: { mask: Uint8Array } | { corners: readonly { x: number; y: number }[] };
  points: number; // to be placed on it, at most
}

export const OBJECT_POINTS = 2 ** 32;

/**
 * Points of an object whose numbers i are the same modulo this had one place on it, one after the other: a point that has
 * left is replaced by one that is placed anew.
 */
export const OBJECT_PLACES = 256;

/** The id that point i of an object has in messages. */
export const objectPointId = (object: number, i: number) => OBJECT_POINTS * object + i;

/** One point on consecutive frames: element i belongs to frame firstFrame + i. */
export interface Run {
  id: number;
  firstFrame: number;
  x: number[];
  y: number[];
  visible: boolean[];
  confidence: number[];
  finalCount: number; // the first so many will never be revised
}

/** An object on one frame, as its points say together. */
export interface ObjectSample {
  x: number; // of its centre, pixels
  y: number;
  scale: number; // since it was drawn
  rotation: number; // radians since then, from x towards y
  visible: number; // share of its points, 0 .. 1
  outline: [number, number][]; // corners, pixels
  left: number[]; // points that do not move with it any more, by their number i on it
  joined: number[]; // points that take part from this frame on, each in place of i - OBJECT_PLACES
}

/** One object on consecutive frames: element i belongs to frame firstFrame + i. */
export interface ObjectRun {
  id: number;
  firstFrame: number;
  samples: ObjectSample[];
  finalCount: number; // the first so many will never be revised
}

/** Why a session, or an attempt to open one, ended. */
export interface Problem {
  code: number;
  text: string;
  retryAfterMs?: number; // the server's word on when to ask again
}

const FIRST_OBJECT_POINT = 2n ** 63n;
const toId = (id: number) => BigInt(id) + (id < OBJECT_POINTS ? 0n : FIRST_OBJECT_POINT);
const fromId = (id: bigint) => Number(id < FIRST_OBJECT_POINT ? id : id - FIRST_OBJECT_POINT);

// Of an object's point, on that object.
const toNumber = (id: bigint) => fromId(id) % OBJECT_POINTS;

const points = (seeds: readonly Seed[]) => seeds.map(({ id, x, y }) => ({ id: toId(id), x, y }));

function shapeMessage(shape: ObjectSeed["shape"]) {
  if ("mask" in shape) return { case: "maskPng" as const, value: shape.mask };
  return { case: "polygon" as const, value: { x: shape.corners.map(({ x }) => x), y: shape.corners.map(({ y }) => y) } };
}

const objects = (seeds: readonly ObjectSeed[]) =>
  seeds.map(({ id, shape, points }) => ({ id, points, shape: shapeMessage(shape) }));

const encode = (request: Parameters<typeof create<typeof TrackRequestSchema>>[1]) =>
  toBinary(TrackRequestSchema, create(TrackRequestSchema, request));

export const makeConfig = (init: Parameters<typeof create<typeof SessionConfigSchema>>[1]) =>
  create(SessionConfigSchema, init);

export const configMessage = (config: SessionConfig, resumeToken: Uint8Array) =>
  encode({ request: { case: "config", value: { ...config, resumeToken } } });

export function frameMessage(index: number, data: Uint8Array, seeds: readonly Seed[], painted: readonly ObjectSeed[]) {
  const value = { index: BigInt(index), data, points: points(seeds), objects: objects(painted) };
  return encode({ request: { case: "frame", value } });
}

export const addMessage = (seeds: readonly Seed[]) =>
  encode({ request: { case: "addPoints", value: { points: points(seeds) } } });

export const removeMessage = (ids: readonly number[]) =>
  encode({ request: { case: "removePoints", value: { ids: ids.map(toId) } } });

export const finishMessage = () => encode({ request: { case: "finish", value: {} } });

export const parseResponse = (bytes: Uint8Array): TrackResponse => fromBinary(TrackResponseSchema, bytes);

export function toRun(run: PointRun): Run {
  const { x, y, visible, confidence, finalCount } = run;
  return { id: fromId(run.id), firstFrame: Number(run.firstFrame), x, y, visible, confidence, finalCount };
}

export function toObjectRun(run: ObjectRunMessage): ObjectRun {
  const samples = run.samples.map(({ x, y, scale, rotation, visible, outlineX, outlineY, left, joined }): ObjectSample => {
    const outline = outlineX.map((at, i): [number, number] => [at, outlineY[i]!]);
    return { x, y, scale, rotation, visible, outline, left: left.map(toNumber), joined: joined.map(toNumber) };
  });
  return { id: run.id, firstFrame: Number(run.firstFrame), samples, finalCount: run.finalCount };
}

/** A problem as a sentence for users. */
export function inWords({ code, text }: Problem): string {
  const said = /[.!?]$/.test(text) ? text : `${text}.`;
  if (code === Code.RESOURCE_EXHAUSTED) return `The server has no room for this: ${said}`;
  return said.charAt(0).toUpperCase() + said.slice(1);
}

export function toProblem(status: Status): Problem {
  const problem: Problem = { code: status.code, text: status.message };
  for (const detail of status.details) {
    const delay = anyUnpack(detail, RetryInfoSchema)?.retryDelay;
    if (delay) problem.retryAfterMs = Number(delay.seconds) * 1000 + delay.nanos / 1e6;
    const fields = anyUnpack(detail, BadRequestSchema)?.fieldViolations ?? [];
    const missing = fields.filter((field) => !problem.text.includes(field.description));
    for (const { field, description } of missing) problem.text += `\n${field}: ${description}`;
  }
  return problem;
}
