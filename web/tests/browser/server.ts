// SPDX-License-Identifier: Apache-2.0
import { type ChildProcess, execFile, spawn } from "node:child_process";
import { randomBytes } from "node:crypto";
import { existsSync, mkdtempSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { promisify } from "node:util";

export const run = promisify(execFile);
export const ROOT = resolve(import.meta.dirname, "../../..");
export const BIN = resolve(ROOT, process.env.HOLDFAST_BIN ?? "build/release/bin");
export const CLIP = join(ROOT, "media/pedestrians.mp4");
export const scratch = () => mkdtempSync(join(tmpdir(), "holdfast-web-"));

/** A real server, which can be killed and come back on the same ports. */
export class Server {
  grpc = 0;
  web = 0;
  private readonly folder = scratch();
  private child: ChildProcess | null = null;

  /** With a token it lets in nobody who does not show it. */
  constructor(private readonly token = "") {
    writeFileSync(join(this.folder, "tokens"), `visitor:${token}\n`, { mode: 0o600 });
    writeFileSync(join(this.folder, "keys"), `test:${randomBytes(32).toString("hex")}\n`, { mode: 0o600 });
  }

  get address(): string {
    return `127.0.0.1:${this.grpc}`;
  }
  get url(): string {
    return `http://127.0.0.1:${this.web}/`;
  }

  async start(): Promise<void> {
    const ports = join(scratch(), "ports");
    const flags = [
      `--listen=127.0.0.1:${this.grpc}`,
      `--web_listen=127.0.0.1:${this.web}`,
      "--metrics_listen=127.0.0.1:0",
      `--checkpoint_keys=${join(this.folder, "keys")}`,
      `--port_file=${ports}`,
      "--log_level=warning",
      ...(this.token ? [`--token_file=${join(this.folder, "tokens")}`] : []),
    ];
    const child = spawn(join(BIN, "holdfast-server"), flags, { stdio: ["ignore", "inherit", "inherit"] });
    this.child = child;
    const text = await new Promise<string>((found, failed) => {
      child.once("exit", (code) => failed(new Error(`holdfast-server ended with ${code}`)));
      child.once("error", failed);
      const look = setInterval(() => {
        if (!existsSync(ports)) return;
        clearInterval(look);
        child.removeAllListeners("exit");
        found(readFileSync(ports, "utf8"));
      }, 50);
    });
    const port = (name: string) => Number(new RegExp(`^${name}=(\\d+)$`, "m").exec(text)![1]);
    [this.grpc, this.web] = [port("grpc"), port("web")];
  }

  async stop(signal: NodeJS.Signals = "SIGTERM"): Promise<void> {
    const child = this.child;
    this.child = null;
    if (!child || child.exitCode !== null) return;
    const gone = new Promise((resolve) => child.once("exit", resolve));
    child.kill(signal);
    await gone;
  }
}
