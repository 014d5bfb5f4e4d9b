// SPDX-License-Identifier: Apache-2.0
import { signal } from "@preact/signals";

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

export type Standing = "unknown" | "serving" | "loading" | "token" | "away";

const POLL_MS = 5_000;

/** Asks the server what it runs and how it is, again and again while the page is looked at. */
export class ServerInfo {
  readonly info = signal<Info | null>(null);
  readonly standing = signal<Standing>("unknown");

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
      if (answer.ok) this.info.value = (await answer.json()) as Info;
      this.standing.value = answer.ok ? "serving" : answer.status === 401 ? "token" : answer.status === 503 ? "loading" : "away";
    } catch {
      this.standing.value = "away";
    }
  }
}
