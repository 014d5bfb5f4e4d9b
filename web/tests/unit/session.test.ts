// SPDX-License-Identifier: Apache-2.0
import { expect, test } from "vitest";
import { SessionState } from "../../src/session";
import { makeConfig, type SessionAccepted } from "../../src/wire";
import { objectPointId } from "../../src/wire";
import { accepted, checkpoint, inMessages, nameOf, objectRun, request, response, run, tracks } from "./support";

const JPEG = new Uint8Array(100);

function begun(more: object = {}, bufferBytes?: number): SessionState {
  const session = new SessionState(makeConfig({}), bufferBytes);
  begin(session, more);
  return session;
}

function begin(session: SessionState, more: object = {}): boolean {
  return session.begin(accepted(more).response.value as SessionAccepted);
}

function leaving(session: SessionState): string[] {
  const names = [];
  for (let bytes; (bytes = session.takeMessage()); ) names.push(nameOf(bytes));
  return names;
}

/** Frames that a source that is never short of them can give before the session wants no more. */
function fill(session: SessionState): string[] {
  const names = [];
  while (session.wantsFrame) {
    session.pushFrame(JPEG, session.frames === 0 ? [{ id: 1, x: 1, y: 1 }] : []);
    names.push(...leaving(session));
  }
  return names;
}

test("no frame is wanted before a server has taken the session", () => {
  expect(new SessionState(makeConfig({})).wantsFrame).toBe(false);
  expect(begun().wantsFrame).toBe(true);
});

test("frames are hop + 4 ahead of those that were processed, never more", () => {
  const session = begun();
  expect(fill(session)).toHaveLength(12);
  session.take(tracks(3));
  expect(fill(session)).toEqual(["frame 12", "frame 13", "frame 14"]);
});

test("a session without points goes by the server's word as well", () => {
  const session = begun();
  while (session.wantsFrame) {
    session.pushFrame(JPEG, []);
    leaving(session);
  }
  expect(session.frames).toBe(12);
  session.take(tracks(1));
  expect(session.wantsFrame).toBe(true);
});

test("an object goes with its frame, and its points have ids of its own", () => {
  const session = begun();
  const corners = [{ x: 1, y: 2 }, { x: 30, y: 2 }, { x: 1, y: 40 }];
  session.pushFrame(JPEG, [], [{ id: 5, shape: { mask: new Uint8Array([1, 2]) }, points: 24 }, { id: 40, shape: { corners }, points: 8 }]);
  session.removePoints([objectPointId(5, 0), objectPointId(5, 23), 7]);
  const [frame, removal] = [request(session.takeMessage()!), request(session.takeMessage()!)];
  expect(frame.case === "frame" && frame.value.objects).toMatchObject([
    { id: 5, points: 24, shape: { case: "maskPng" } },
    { id: 40, points: 8, shape: { case: "polygon", value: { x: [1, 30, 1], y: [2, 2, 40] } } },
  ]);
  const first = 2n ** 63n + 5n * 2n ** 32n;
  expect(removal.case === "removePoints" && removal.value.ids).toEqual([first, first + 23n, 7n]);
  expect(inMessages(objectPointId(5, 23))).toBe(first + 23n);
});

test("what is final of an object comes once, and says which points have left it", () => {
  const session = begun();
  const answer = session.take(tracks(12, [run(objectPointId(5, 3), 0, 2)], [objectRun(5, 0, 12, 5, 0, [1, 3])]));
  expect(answer).toMatchObject({ runs: [{ id: objectPointId(5, 3) }], objects: [objectRun(5, 0, 12, 5, 0, [1, 3])] });
  begin(session);
  const again = session.take(tracks(12, [], [objectRun(5, 0, 12, 8), objectRun(6, 0, 3, 1)]));
  expect(again.kind === "tracks" && again.objects).toEqual([objectRun(5, 5, 7, 3), objectRun(6, 0, 3, 1)]);
  const finals = session.take(tracks(12, [], [objectRun(5, 0, 5, 5)]));
  expect(finals.kind === "tracks" && finals.objects).toEqual([]);
});

test("points go with their frame, or on the newest one, in the order in which they were placed", () => {
  const session = begun();
  session.pushFrame(JPEG, [{ id: 7, x: 1.5, y: 2 }]);
  session.addPoints([{ id: 8, x: 3, y: 4 }]);
  session.removePoints([7]);
  session.finish();
  session.finish();
  const first = request(session.takeMessage()!);
  expect(first.case === "frame" && first.value.points).toMatchObject([{ id: 7n, x: 1.5, y: 2 }]);
  expect(leaving(session)).toEqual(["addPoints", "removePoints", "finish"]);
  expect(session.wantsFrame).toBe(false);
});

test("the first server's choices are kept for the next one", () => {
  const session = begun({ hopFrames: 12, iterations: 3, polish: true });
  expect(request(session.opening()).value).toMatchObject({ hopFrames: 12, iterations: 3, polish: true });
});

test("a session goes on with its newest checkpoint, and sends what came since again", () => {
  const session = begun();
  fill(session);
  session.take(tracks(12));
  session.addPoints([{ id: 9, x: 1, y: 1 }]); // on frame 11
  expect(leaving(session)).toEqual(["addPoints"]);
  fill(session);
  expect(session.take(checkpoint(12, "newest"))).toEqual({ kind: "checkpoint", nextFrame: 12, resumable: true });
  const opening = request(session.opening());
  expect(opening.case === "config" && new TextDecoder().decode(opening.value.resumeToken)).toBe("newest");
  expect(begin(session, { firstFrame: 12n })).toBe(true);
  expect(leaving(session)).toEqual([12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23].map((t) => `frame ${t}`));
});

test("frames that are sent again do not wait for a server that says nothing of them", () => {
  const session = begun();
  for (let processed = 0; processed < 30; processed += 5) {
    session.take(tracks(processed));
    fill(session);
  }
  begin(session, { firstFrame: 0n });
  expect(leaving(session)).toHaveLength(37);
  expect(session.wantsFrame).toBe(false);
  session.take(tracks(3)); // of a server that began at the beginning
  expect(session.processed).toBe(25);
});

test("final estimates come once, however often servers repeat them", () => {
  const session = begun();
  session.take(tracks(12, [run(1, 0, 12, 5)]));
  begin(session);
  const answer = session.take(tracks(12, [run(1, 0, 12, 8), run(2, 0, 3, 1)]));
  expect(answer.kind === "tracks" && answer.runs).toEqual([run(1, 5, 7, 3), run(2, 0, 3, 1)]);
  const finals = session.take(tracks(12, [run(1, 0, 5, 5)]));
  expect(finals.kind === "tracks" && finals.runs).toEqual([]);
});

test("without a loss, estimates are handed on as they are", () => {
  const session = begun();
  session.take(tracks(12, [run(1, 0, 12, 5)]));
  const again = session.take(tracks(12, [run(1, 3, 9, 4)]));
  expect(again.kind === "tracks" && again.runs).toEqual([run(1, 3, 9, 4)]);
});

test("a session that outgrew its checkpoints says so, and keeps nothing", () => {
  const session = begun();
  fill(session);
  expect(session.take(checkpoint(4, "")).kind).toBe("warning");
  expect(session.replay.keeps).toBe(false);
  expect(session.take(checkpoint(5)).kind).toBe("nothing");
});

test("a server without checkpoints is not kept for", () => {
  expect(begun({ replayFrames: 0 }).replay.keeps).toBe(false);
});

test("a full buffer waits for a checkpoint where one can make room, and does without where none can", () => {
  const waiting = begun({ replayFrames: 1, checkpointIntervalFrames: 1 }, 350);
  expect(fill(waiting)).toHaveLength(4);
  expect(waiting.wantsFrame).toBe(false);
  waiting.take(checkpoint(3));
  expect(waiting.wantsFrame).toBe(true);
  const small = begun({ replayFrames: 30 }, 350);
  expect(fill(small)).toHaveLength(12);
  expect(small.replay.keeps).toBe(false);
});

test("the end, and warnings, are told in words", () => {
  const session = begun();
  const status = { code: 3, message: "frame 4 does not decode", details: [] };
  expect(session.take(response({ case: "error", value: status }))).toEqual({
    kind: "error",
    problem: { code: 3, text: "frame 4 does not decode" },
  });
  expect(session.take(response({ case: "warning", value: status }))).toEqual({ kind: "warning", text: status.message });
  expect(session.take(response({ case: "goingAway", value: { timeLeft: { seconds: 20n, nanos: 0 } } }))).toEqual({
    kind: "goingAway",
    seconds: 20,
  });
  expect(session.take(response({ case: "summary", value: {} }))).toEqual({ kind: "summary" });
  expect(session.take(response({ case: undefined }))).toEqual({ kind: "nothing" });
});
