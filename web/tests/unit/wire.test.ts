// SPDX-License-Identifier: Apache-2.0
import { create } from "@bufbuild/protobuf";
import { anyPack } from "@bufbuild/protobuf/wkt";
import { expect, test } from "vitest";
import { subprotocols } from "../../src/connection";
import { BadRequestSchema, RetryInfoSchema } from "../../src/gen/google/rpc/error_details_pb";
import { StatusSchema } from "../../src/gen/google/rpc/status_pb";
import { Code, inWords, toProblem } from "../../src/wire";

test("a refusal says when to come again", () => {
  const retry = create(RetryInfoSchema, { retryDelay: { seconds: 1n, nanos: 500_000_000 } });
  const status = create(StatusSchema, { code: 8, message: "full", details: [anyPack(RetryInfoSchema, retry)] });
  expect(toProblem(status)).toEqual({ code: 8, text: "full", retryAfterMs: 1500 });
});

test("fields that are wrong are named, once", () => {
  const bad = create(BadRequestSchema, {
    fieldViolations: [
      { field: "config.hop_frames", description: "24 is not in 1 .. 23" },
      { field: "config.iterations", description: "99 is not in 1 .. 64" },
    ],
  });
  const message = "config.hop_frames: 24 is not in 1 .. 23";
  const status = create(StatusSchema, { code: 3, message, details: [anyPack(BadRequestSchema, bad)] });
  expect(toProblem(status).text).toBe(`${message}\nconfig.iterations: 99 is not in 1 .. 64`);
});

test("users are told problems in sentences", () => {
  expect(inWords({ code: Code.UNAUTHENTICATED, text: "the token is unknown" })).toBe("The token is unknown.");
  expect(inWords({ code: Code.RESOURCE_EXHAUSTED, text: "sessions: all 1 are in use" })).toBe(
    "The server has no room for this: sessions: all 1 are in use.");
  expect(inWords({ code: Code.UNAVAILABLE, text: "Lost: it broke." })).toBe("Lost: it broke.");
});

test("a token travels as a subprotocol, in base64url without padding", () => {
  expect(subprotocols("")).toEqual(["holdfast.v1"]);
  expect(subprotocols("s3cret?>ü")).toEqual(["holdfast.v1", "bearer.czNjcmV0Pz7DvA"]);
});
