// SPDX-License-Identifier: Apache-2.0
import type { Answer, SessionState } from "./session";
import { Code, parseResponse, type Problem, type SessionAccepted } from "./wire";

/** What the page needs of a WebSocket. */
export interface Socket {
  binaryType: BinaryType;
  readonly bufferedAmount: number; // bytes
  onopen: ((event: Event) => void) | null;
  onmessage: ((event: MessageEvent) => void) | null;
  onclose: ((event: CloseEvent) => void) | null;
  send(data: Uint8Array<ArrayBuffer>): void;
  close(): void;
}

/** The world around a connection; tests have their own. */
export interface World {
  open(): Socket;
  now(): number; // ms, steady
  after(ms: number, call: () => void): () => void; // the result takes the call back
  hidden(): boolean; // nobody looks, and timers are slow
  refusal(): string; // why there may be no socket, as browsers do not tell
  random(): number; // 0 .. 1
}

/** How a session stands to its server. */
export type Link =
  | { state: "connecting" }
  | { state: "open" }
  | { state: "waiting"; until: number; why: string } // for the next attempt, at a time of World.now
  | { state: "parked" } // the server let an idle session go; the next message takes it up again
  | { state: "ended"; problem: Problem | null };

export interface Observer {
  onLink(link: Link): void;
  onAccepted(accepted: SessionAccepted, resumed: boolean): void;
  onAnswer(answer: Answer): void;
  onRoom(): void; // the network has caught up
}

const ANSWER_MS = 10_000; // for a server to accept the session, and as long beside as the config takes to get there
const SLOWEST_BYTES_PER_MS = 32; // of an uplink: a token may have megabytes
const GIVE_UP_MS = 120_000; // for a server to take a lost session over, and to get on with it
const FIRST_WAIT_MS = 100;
const LONGEST_WAIT_MS = 5_000;
const WAIT_FACTOR = 1.6;
const BUFFERED_BYTES = 1 << 20; // more than this waits for the network
const BUFFERED_POLL_MS = 20; // a WebSocket does not say when it has room again

/**
 * Carries one session over WebSockets, one after the other: when a server is lost, the next attempt follows, with the
 * newest checkpoint's token, until a server goes on or the time for it is over. A session that kills every server, so that
 * none comes to a frame that is new, comes to an end too: what is lost again counts as the same loss.
 */
export class Connection {
  private socket: Socket | null = null;
  private open = false; // a server has the session
  private begun = false; // one has had it
  private ended = false;
  private parked = false;
  private ending: Problem | null = null; // what the server said at the end
  private deadline = 0; // of the loss that is not over yet; 0: there is none
  private wait = FIRST_WAIT_MS;
  private taken = 0; // when the last server took the session
  private processed = 0; // frames, as of the last loss
  private takeBack: () => void = () => {};
  private polling = false;

  constructor(
    private readonly session: SessionState,
    private readonly world: World,
    private readonly observer: Observer,
  ) {}

  start(): void {
    this.connect();
  }

  /** Sends what may leave. To be called whenever something was pushed. */
  flush(): void {
    if (!this.open) {
      if (this.parked && this.session.replay.unsent > 0) this.search("the server let the idle session go");
      return;
    }
    while (this.socket!.bufferedAmount <= BUFFERED_BYTES) {
      const bytes = this.session.takeMessage();
      if (!bytes) return;
      this.socket!.send(bytes as Uint8Array<ArrayBuffer>);
    }
    this.pollBuffered();
  }

  /** Whether fewer bytes than that wait for the network. Otherwise onRoom() says when to ask again. */
  hasRoom(bytes: number): boolean {
    if (!this.open || this.socket!.bufferedAmount < bytes) return true;
    this.pollBuffered();
    return false;
  }

  /** Does not wait for the next attempt. */
  retryNow(): void {
    if (!this.socket && this.begun && !this.ended) this.connect();
  }

  /** Ends it here and now. */
  stop(problem: Problem | null = null): void {
    if (this.ended) return;
    this.ended = true;
    this.letGo();
    this.observer.onLink({ state: "ended", problem });
  }

  private connect(): void {
    this.letGo();
    this.observer.onLink({ state: "connecting" });
    this.ending = null;
    const opening = this.session.opening() as Uint8Array<ArrayBuffer>;
    const socket = this.world.open();
    socket.binaryType = "arraybuffer";
    socket.onopen = () => socket.send(opening);
    socket.onmessage = (event) => this.receive(new Uint8Array(event.data as ArrayBuffer));
    socket.onclose = () => this.closed();
    this.socket = socket;
    this.takeBack = this.world.after(ANSWER_MS + opening.length / SLOWEST_BYTES_PER_MS, () => this.closed("no answer came in time"));
  }

  private receive(bytes: Uint8Array): void {
    const message = parseResponse(bytes);
    if (message.response.case === "accepted") return this.accept(message.response.value);
    const answer = this.session.take(message);
    if (answer.kind === "error") this.ending = answer.problem;
    this.observer.onAnswer(answer);
    if (answer.kind === "summary") return this.stop();
    if (answer.kind === "error") return this.closed();
    this.flush();
  }

  private accept(accepted: SessionAccepted): void {
    this.takeBack();
    if (!this.session.begin(accepted)) {
      const text = `The server would go on at frame ${accepted.firstFrame}, which is not kept any more.`;
      return this.stop({ code: Code.INTERNAL, text });
    }
    const resumed = this.begun;
    this.open = this.begun = true;
    this.taken = this.world.now();
    this.observer.onLink({ state: "open" });
    this.observer.onAccepted(accepted, resumed);
    this.flush();
  }

  private closed(why = "the connection broke"): void {
    const problem = this.ending;
    const idle = this.open && problem?.code === Code.DEADLINE_EXCEEDED;
    if (this.open && this.recovered()) this.beginAnew();
    this.letGo();
    if (!this.begun) return this.stop(problem ?? { code: Code.UNAVAILABLE, text: this.world.refusal() });
    if (!this.session.replay.keeps) return this.stop(problem ?? { code: Code.UNAVAILABLE, text: `Lost: ${why}.` });
    if (idle) return this.park();
    const temporary = !problem || problem.code === Code.UNAVAILABLE || problem.retryAfterMs !== undefined;
    if (!temporary) return this.stop(problem);
    this.search(problem?.text || why, problem?.retryAfterMs);
  }

  private park(): void {
    this.beginAnew();
    this.parked = true;
    this.observer.onLink({ state: "parked" });
    this.flush();
  }

  // Of a server that had the session: it came to new frames, or lasted.
  private recovered(): boolean {
    const before = this.processed;
    this.processed = this.session.processed;
    return this.processed > before || this.world.now() - this.taken > GIVE_UP_MS;
  }

  // The next loss has all the time again.
  private beginAnew(): void {
    this.deadline = 0;
    this.wait = FIRST_WAIT_MS;
  }

  private search(why: string, notBefore = 0): void {
    this.parked = false;
    const now = this.world.now();
    if (this.deadline === 0) this.deadline = now + GIVE_UP_MS;
    const pause = Math.max(this.wait * (0.8 + 0.4 * this.world.random()), notBefore);
    this.wait = Math.min(this.wait * WAIT_FACTOR, LONGEST_WAIT_MS);
    if (now + pause > this.deadline) {
      return this.stop({ code: Code.UNAVAILABLE, text: `No server took the session over in time: ${why}.` });
    }
    this.observer.onLink({ state: "waiting", until: now + pause, why });
    this.takeBack = this.world.after(pause, () => this.connect());
  }

  private letGo(): void {
    this.takeBack();
    this.takeBack = () => {};
    this.open = this.parked = false;
    const socket = this.socket;
    this.socket = null;
    if (!socket) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
  }

  private pollBuffered(): void {
    if (this.polling) return;
    this.polling = true;
    this.world.after(BUFFERED_POLL_MS, () => {
      this.polling = false;
      this.flush();
      if (this.session.replay.unsent === 0) this.observer.onRoom();
    });
  }
}

/** Names of what the page speaks on its WebSocket; a token travels as one of them, as browsers set no headers there. */
export function subprotocols(token: string): string[] {
  if (!token) return ["holdfast.v1"];
  const base64 = btoa(String.fromCharCode(...new TextEncoder().encode(token)));
  return ["holdfast.v1", `bearer.${base64.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "")}`];
}
