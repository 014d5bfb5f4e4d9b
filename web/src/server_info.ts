// SPDX-License-Identifier: Apache-2.0
import { computed, signal } from "@preact/signals";

/** What the server says of itself: GetServerInfoResponse in protobuf's JSON. */
export interface Info {
  modelName?: string;
  preset?: string;
  weightsSha256?: string;
  precision?: string;
  device?: string;
  build?: string;
  defaultProcessingSize?: { width: number; height: number };
  windowFrames?: number;
  defaultHopFrames?: number;
  defaultIterations?: number;
  maxSessions?: number;
  limits?: { maxPoints?: number; maxFrames?: string };
  calibratedConfidence?: boolean;
  load?: { sessions?: number; points?: string };
}

/** What the server was doing at one time. */
export interface Load {
  seconds: number; // since the page was opened
  sessions: number;
  points: number; // followed, over all sessions
}

export type Standing = "unknown" | "serving" | "loading" | "token" | "away";

const POLL_MS = 3_000;
const KEPT_LOADS = 100; // five minutes

/** Asks the server what it runs and how it is, again and again while the page is looked at. */
export class ServerInfo {
  readonly info = signal<Info | null>(null);
  readonly standing = signal<Standing>("unknown");
  /** The newest ones; empty: the server said nothing yet. */
  readonly loads = signal<Load[]>([]);

  readonly words = computed(() => this.inWords(this.standing.value));

  constructor(private readonly token: () => string) {}

  start(): void {
    void this.ask();
    setInterval(() => {
      if (document.visibilityState === "visible") void this.ask();
    }, POLL_MS);
  }

  async ask(): Promise<void> {
    try {
      const token = this.token();
      const headers: HeadersInit = token ? { Authorization: `Bearer ${token}` } : {};
      const answer = await fetch("v1/info", { headers, cache: "no-store" });
      if (answer.ok) this.take((await answer.json()) as Info);
      this.standing.value = answer.ok ? "serving" : answer.status === 401 ? "token" : answer.status === 503 ? "loading" : "away";
    } catch {
      this.standing.value = "away";
    }
  }

  private inWords(standing: Standing): string {
    switch (standing) {
      case "unknown":
        return "Asking the server …";
      case "serving":
        return "Serving";
      case "loading":
        return "The server is loading";
      case "token":
        return this.token() ? "The server does not know this token" : "The server wants a token";
      case "away":
        return "The server does not answer";
    }
  }

  private take(info: Info): void {
    const { sessions = 0, points = "0" } = info.load ?? {}; // JSON has no zeros
    const load = { seconds: performance.now() / 1000, sessions, points: Number(points) };
    this.info.value = info;
    this.loads.value = [...this.loads.value.slice(1 - KEPT_LOADS), load];
  }
}
