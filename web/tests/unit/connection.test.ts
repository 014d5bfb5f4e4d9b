// SPDX-License-Identifier: Apache-2.0
import { expect, test } from "vitest";
import { Connection, type Link } from "../../src/connection";
import { type Answer, SessionState } from "../../src/session";
import { Code, makeConfig, type SessionAccepted } from "../../src/wire";
import { accepted, checkpoint, FakeWorld, response, tracks } from "./support";

/** A session over fake sockets, and what it told. */
class Client {
  readonly world = new FakeWorld();
  readonly session = new SessionState(makeConfig({}));
  readonly links: Link[] = [];
  readonly answers: Answer[] = [];
  resumed = 0;
  rooms = 0;
  readonly connection = new Connection(this.session, this.world, {
    onLink: (link) => this.links.push(link),
    onAccepted: (_accepted: SessionAccepted, resumed) => (this.resumed += resumed ? 1 : 0),
    onAnswer: (answer) => this.answers.push(answer),
    onRoom: () => ++this.rooms,
  });

  get link(): Link {
    return this.links.at(-1)!;
  }
  accept(more: object = {}): void {
    this.world.socket.open();
    this.world.socket.say(accepted(more));
  }
  push(frames: number): void {
    for (let i = 0; i < frames; ++i) this.session.pushFrame(new Uint8Array(10), []);
    this.connection.flush();
  }
}

function following(): Client {
  const client = new Client();
  client.connection.start();
  client.accept();
  return client;
}

const ended = (code: number, message = "") => response({ case: "error", value: { code, message, details: [] } });

test("the config goes first, and frames once the server has taken the session", () => {
  const client = new Client();
  client.connection.start();
  client.world.socket.open();
  expect(client.world.socket.names).toEqual(["config"]);
  client.world.socket.say(accepted());
  client.push(2);
  expect(client.world.socket.names).toEqual(["config", "frame 0", "frame 1"]);
  expect(client.link).toEqual({ state: "open" });
});

test("a summary ends the session well", () => {
  const client = following();
  client.world.socket.say(response({ case: "summary", value: {} }));
  expect(client.link).toEqual({ state: "ended", problem: null });
  expect(client.world.socket.closed).toBe(true);
});

test("without a server at the start the session ends at once", () => {
  const client = new Client();
  client.connection.start();
  client.world.socket.break();
  expect(client.link).toMatchObject({ state: "ended", problem: { code: Code.UNAVAILABLE } });
});

test("a server that does not answer in time counts as none", () => {
  const client = new Client();
  client.connection.start();
  client.world.socket.open();
  client.world.pass(10_100);
  expect(client.link).toMatchObject({ state: "ended", problem: { code: Code.UNAVAILABLE } });
});

test("a server has the longer to answer the larger the token is that goes to it", () => {
  const client = following();
  client.push(10);
  client.world.socket.say(checkpoint(6, "t".repeat(3_200_000)));
  client.world.socket.break();
  client.world.pass(100);
  client.world.socket.open();
  client.world.pass(100_000);
  expect(client.link).toEqual({ state: "connecting" });
  client.world.pass(11_000);
  expect(client.links).toContainEqual(expect.objectContaining({ state: "waiting", why: "no answer came in time" }));
});

test("a lost server is sought again, and takes up where its checkpoint says", () => {
  const client = following();
  client.push(10);
  client.world.socket.say(tracks(8));
  client.world.socket.say(checkpoint(6));
  client.world.socket.break();
  expect(client.link).toMatchObject({ state: "waiting", until: 100 });
  client.world.pass(100);
  expect(client.link).toEqual({ state: "connecting" });
  client.accept({ firstFrame: 6n });
  expect(client.resumed).toBe(1);
  expect(client.world.socket.names).toEqual(["config", "frame 6", "frame 7", "frame 8", "frame 9"]);
});

test("a server that ends as planned is as good as lost", () => {
  const client = following();
  client.world.socket.say(ended(Code.UNAVAILABLE, "the server is shutting down"));
  expect(client.link).toMatchObject({ state: "waiting", why: "the server is shutting down" });
});

test("attempts come ever more rarely, for two minutes", () => {
  const client = following();
  const waits: number[] = [];
  client.world.socket.break();
  while (client.link.state === "waiting") {
    const wait = client.link.until - client.world.time;
    waits.push(Math.round(wait));
    client.world.pass(wait);
    client.world.socket.break();
  }
  expect(waits.slice(0, 4)).toEqual([100, 160, 256, 410]);
  expect(Math.max(...waits)).toBe(5000);
  expect(client.world.time).toBeGreaterThan(110_000);
  expect(client.link).toMatchObject({ state: "ended", problem: { code: Code.UNAVAILABLE } });
});

test("a session that kills every server comes to an end", () => {
  const client = following();
  client.push(10);
  client.world.socket.say(tracks(8));
  client.world.socket.say(checkpoint(6));
  client.world.socket.break();
  for (let servers = 1; servers < 100 && client.link.state === "waiting"; ++servers) {
    client.world.pass(client.link.until - client.world.time);
    client.accept({ firstFrame: 6n });
    client.world.socket.say(tracks(8)); // as far as the others came
    client.world.socket.break();
  }
  expect(client.link).toMatchObject({ state: "ended", problem: { code: Code.UNAVAILABLE } });
  expect(client.world.time).toBeGreaterThan(110_000);
  expect(client.world.time).toBeLessThan(120_000);
});

test("after new frames, or a long time, the next loss is another one", () => {
  const client = following();
  client.push(10);
  client.world.socket.say(checkpoint(0));
  const lose = () => {
    client.world.socket.break();
    if (client.link.state !== "waiting") throw new Error(client.link.state);
    const wait = client.link.until - client.world.time;
    client.world.pass(wait);
    client.accept();
    return Math.round(wait);
  };
  expect([lose(), lose(), lose()]).toEqual([100, 160, 256]);
  client.world.socket.say(tracks(1));
  expect([lose(), lose()]).toEqual([100, 160]);
  client.world.pass(119_000);
  expect(lose()).toBe(256);
  client.world.pass(121_000);
  expect([lose(), lose()]).toEqual([100, 160]);
});

test("the user need not wait", () => {
  const client = following();
  client.world.socket.break();
  client.connection.retryNow();
  expect(client.world.sockets).toHaveLength(2);
  client.accept();
  client.world.pass(1_000); // the attempt that was waited for does not come besides
  expect(client.world.sockets).toHaveLength(2);
});

test("a token that is refused ends the session, and says why", () => {
  const client = following();
  client.world.socket.break();
  client.world.pass(100);
  client.world.socket.open();
  client.world.socket.say(ended(Code.FAILED_PRECONDITION, "made by a server with other keys"));
  expect(client.link).toMatchObject({ state: "ended", problem: { text: "made by a server with other keys" } });
});

test("a mistake of the page's ends the session", () => {
  const client = following();
  client.world.socket.say(ended(3, "frame 4 does not decode"));
  expect(client.link).toMatchObject({ state: "ended", problem: { code: 3 } });
});

test("a session that was left idle is taken up again by its next message", () => {
  const client = following();
  client.push(3);
  client.world.socket.say(ended(Code.DEADLINE_EXCEEDED, "nothing came for 2m"));
  expect(client.link).toEqual({ state: "parked" });
  client.push(1);
  client.world.pass(100);
  client.accept();
  expect(client.world.socket.names).toEqual(["config", "frame 0", "frame 1", "frame 2", "frame 3"]);
});

test("a server that has gone too far to go on is not followed", () => {
  const client = following();
  client.push(10);
  client.world.socket.say(checkpoint(8));
  client.world.socket.break();
  client.world.pass(100);
  client.accept({ firstFrame: 2n });
  expect(client.link).toMatchObject({ state: "ended", problem: { code: Code.INTERNAL } });
});

test("frames wait while the network is behind", () => {
  const client = following();
  client.world.socket.bufferedAmount = 2 << 20;
  client.push(1);
  expect(client.world.socket.names).toEqual(["config"]);
  client.world.socket.bufferedAmount = 0;
  expect(client.rooms).toBe(0);
  client.world.pass(20);
  expect(client.world.socket.names).toEqual(["config", "frame 0"]);
  expect(client.rooms).toBe(1);
});

test("after it was stopped nothing is told or sent any more", () => {
  const client = following();
  const { socket } = client.world;
  client.connection.stop();
  client.push(1);
  socket.say(tracks(1));
  socket.break();
  client.world.pass(200_000);
  expect(socket.names).toEqual(["config"]);
  expect(client.answers).toEqual([]);
  expect(client.world.sockets).toHaveLength(1);
});
