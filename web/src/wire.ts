// SPDX-License-Identifier: Apache-2.0
// The protocol's messages, to and from the page's own plain values. A point's id is a number here: the page chooses
// them, from 1 on.
import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import { anyUnpack } from "@bufbuild/protobuf/wkt";
import { BadRequestSchema, RetryInfoSchema } from "./gen/google/rpc/error_details_pb";
import type { Status } from "./gen/google/rpc/status_pb";
import {
  type PointRun,
  type SessionAccepted,
  type SessionConfig,
  SessionConfigSchema,
  TrackRequestSchema,
  type TrackResponse,
  TrackResponseSchema,
} from "./gen/holdfast/v1/point_tracking_pb";

export type { SessionAccepted, SessionConfig, TrackResponse };

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

/** Why a session, or an attempt to open one, ended. */
export interface Problem {
  code: number;
  text: string;
  retryAfterMs?: number; // the server's word on when to ask again
}

const points = (seeds: readonly Seed[]) => seeds.map(({ id, x, y }) => ({ id: BigInt(id), x, y }));

const encode = (request: Parameters<typeof create<typeof TrackRequestSchema>>[1]) =>
  toBinary(TrackRequestSchema, create(TrackRequestSchema, request));

export const makeConfig = (init: Parameters<typeof create<typeof SessionConfigSchema>>[1]) =>
  create(SessionConfigSchema, init);

export const configMessage = (config: SessionConfig, resumeToken: Uint8Array) =>
  encode({ request: { case: "config", value: { ...config, resumeToken } } });

export const frameMessage = (index: number, data: Uint8Array, seeds: readonly Seed[]) =>
  encode({ request: { case: "frame", value: { index: BigInt(index), data, points: points(seeds) } } });

export const addMessage = (seeds: readonly Seed[]) =>
  encode({ request: { case: "addPoints", value: { points: points(seeds) } } });

export const removeMessage = (ids: readonly number[]) =>
  encode({ request: { case: "removePoints", value: { ids: ids.map(BigInt) } } });

export const finishMessage = () => encode({ request: { case: "finish", value: {} } });

export const parseResponse = (bytes: Uint8Array): TrackResponse => fromBinary(TrackResponseSchema, bytes);

export function toRun(run: PointRun): Run {
  const { x, y, visible, confidence, finalCount } = run;
  return { id: Number(run.id), firstFrame: Number(run.firstFrame), x, y, visible, confidence, finalCount };
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
