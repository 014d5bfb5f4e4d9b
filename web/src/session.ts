// SPDX-License-Identifier: Apache-2.0
import { ReplayBuffer } from "./replay";
import {
  addMessage,
  configMessage,
  finishMessage,
  frameMessage,
  type ObjectRun,
  type ObjectSeed,
  type Problem,
  removeMessage,
  type Run,
  type Seed,
  type SessionAccepted,
  type SessionConfig,
  toObjectRun,
  toProblem,
  toRun,
  type TrackResponse,
  type Tracks,
} from "./wire";

/** What a response means to the page. */
export type Answer =
  | { kind: "tracks"; runs: Run[]; objects: ObjectRun[]; received: number; processed: number }
  | { kind: "checkpoint"; nextFrame: number; resumable: boolean }
  | { kind: "warning"; text: string }
  | { kind: "goingAway"; seconds: number }
  | { kind: "summary" }
  | { kind: "error"; problem: Problem }
  | { kind: "nothing" };

const FRAMES_BEYOND_HOP = 4; // that may be under way to the server, so that it never waits for the next one

/** What is final of a session's points, or of its objects: it comes once, however often servers repeat it. */
class Finals {
  private ends = new Map<number, number>(); // of each, the frames before this one are final
  private repeated = new Map<number, number>(); // as of the last resume: what is before comes again

  resume(): void {
    this.repeated = new Map(this.ends);
  }

  /** So many frames at the beginning of a run are known. */
  known({ id, firstFrame }: { id: number; firstFrame: number }, length: number): number {
    return Math.min(Math.max((this.repeated.get(id) ?? 0) - firstFrame, 0), length);
  }

  note({ id, firstFrame, finalCount }: { id: number; firstFrame: number; finalCount: number }): void {
    if (finalCount > 0) this.ends.set(id, Math.max(this.ends.get(id) ?? 0, firstFrame + finalCount));
  }

  forget(id: number): void {
    this.ends.delete(id);
  }

  /** Nothing of frames before this one comes again. */
  forgetBefore(frame: number): void {
    for (const [id, end] of this.ends) if (end <= frame) this.ends.delete(id);
  }
}

/**
 * A session as its client sees it, without a network: what is to be sent, what may have to be sent again, and what came
 * back. Its server may be lost and another one go on: begin() is called for each.
 */
export class SessionState {
  accepted: SessionAccepted | null = null;
  /** Frames whose features the servers have computed. */
  processed = 0;
  readonly replay = new ReplayBuffer();
  private token: Uint8Array = new Uint8Array();
  private nextIndex = 0;
  private finished = false;
  private finals = new Finals();
  private objectFinals = new Finals();

  constructor(
    readonly config: SessionConfig,
    private readonly bufferBytes = 256 << 20,
  ) {}

  // --- What is sent.

  /** Index of the frame that pushFrame() would take; the newest frame is the one before. */
  get frames(): number {
    return this.nextIndex;
  }

  /** The first message to a server. */
  opening(): Uint8Array {
    return configMessage(this.config, this.token);
  }

  /** Whether a source may give the next frame now: the server keeps up, and what has to be kept has room. */
  get wantsFrame(): boolean {
    return this.accepted !== null && !this.finished && this.replay.unsent === 0 && this.mayLeave(this.nextIndex) &&
      this.hasRoom();
  }

  /** The next frame, with the points and objects that begin on it. */
  pushFrame(data: Uint8Array, seeds: readonly Seed[], objects: readonly ObjectSeed[] = []): void {
    const frame = this.nextIndex++;
    this.replay.push({ bytes: frameMessage(frame, data, seeds, objects), frame });
  }

  /** Points on the newest frame; known ones begin anew there. */
  addPoints(seeds: readonly Seed[]): void {
    this.replay.push({ bytes: addMessage(seeds), frame: null });
  }

  /** An object goes with the last one of its points. */
  removePoints(ids: readonly number[]): void {
    this.replay.push({ bytes: removeMessage(ids), frame: null });
    for (const id of ids) this.finals.forget(id);
  }

  /** No more frames come; everything becomes final. */
  finish(): void {
    if (this.finished) return;
    this.finished = true;
    this.replay.push({ bytes: finishMessage(), frame: null });
  }

  /** The next message that may leave now, and counts as sent. */
  takeMessage(): Uint8Array | null {
    const message = this.replay.peek();
    if (!message || (message.frame !== null && !this.mayLeave(message.frame))) return null;
    this.replay.advance();
    return message.bytes;
  }

  // --- What comes back.

  /** A server took the session: all that is kept is sent again. False: it would go on at a frame that is gone. */
  begin(accepted: SessionAccepted): boolean {
    if (!this.accepted) this.settle(accepted);
    this.accepted = accepted;
    this.finals.resume();
    this.objectFinals.resume();
    return this.replay.rewind(Number(accepted.firstFrame));
  }

  take({ response }: TrackResponse): Answer {
    switch (response.case) {
      case "tracks":
        return this.takeTracks(response.value);
      case "checkpoint":
        return this.takeCheckpoint(response.value.token, Number(response.value.nextFrame), response.value.resumable);
      case "warning":
        return { kind: "warning", text: response.value.message };
      case "goingAway":
        return { kind: "goingAway", seconds: Number(response.value.timeLeft?.seconds ?? 0n) };
      case "summary":
        return { kind: "summary" };
      case "error":
        return { kind: "error", problem: toProblem(response.value) };
      default:
        return { kind: "nothing" }; // of a newer server
    }
  }

  // Frames that are sent again do not wait: a server that goes on says nothing of those that were processed before.
  private mayLeave(frame: number): boolean {
    return frame - this.processed < (this.accepted?.hopFrames ?? 0) + FRAMES_BEYOND_HOP;
  }

  // A full buffer waits for a checkpoint. Where none can make room, the session has to do without.
  private hasRoom(): boolean {
    if (!this.replay.keeps || this.replay.bytes < this.bufferBytes || !this.accepted) return true;
    const { replayFrames, checkpointIntervalFrames } = this.accepted;
    if (this.replay.frames > replayFrames + checkpointIntervalFrames) return false;
    this.replay.keepNothing();
    return true;
  }

  // What the first server chose stays, whatever another one's defaults are.
  private settle(accepted: SessionAccepted): void {
    const { processingSize, hopFrames, iterations, motionPrior, polish } = accepted;
    Object.assign(this.config, { processingSize, hopFrames, iterations, motionPrior, polish });
    if (accepted.replayFrames === 0) this.replay.keepNothing();
  }

  private takeTracks(tracks: Tracks): Answer {
    const runs = tracks.runs.map((run) => this.unknownPart(toRun(run))).filter((run) => run.x.length > 0);
    const objects = tracks.objects.map((run) => this.unknownObjectPart(toObjectRun(run))).filter((run) => run.samples.length > 0);
    for (const run of runs) this.finals.note(run);
    for (const run of objects) this.objectFinals.note(run);
    this.processed = Math.max(this.processed, Number(tracks.framesProcessed));
    return { kind: "tracks", runs, objects, received: Number(tracks.framesReceived), processed: this.processed };
  }

  private unknownPart(run: Run): Run {
    const drop = this.finals.known(run, run.x.length);
    if (drop === 0) return run;
    return {
      ...without(run, drop),
      x: run.x.slice(drop),
      y: run.y.slice(drop),
      visible: run.visible.slice(drop),
      confidence: run.confidence.slice(drop),
    };
  }

  private unknownObjectPart(run: ObjectRun): ObjectRun {
    const drop = this.objectFinals.known(run, run.samples.length);
    return { ...without(run, drop), samples: run.samples.slice(drop) };
  }

  private takeCheckpoint(token: Uint8Array, nextFrame: number, resumable: boolean): Answer {
    if (!this.replay.keeps) return { kind: "nothing" };
    if (token.length === 0) {
      this.replay.keepNothing();
      return { kind: "warning", text: "The session has outgrown what a checkpoint holds: it ends with its server." };
    }
    if (!this.replay.dropBefore(nextFrame)) return { kind: "nothing" };
    const oldest = nextFrame - (this.accepted?.windowFrames ?? 0);
    this.finals.forgetBefore(oldest);
    this.objectFinals.forgetBefore(oldest);
    this.token = token;
    return { kind: "checkpoint", nextFrame, resumable };
  }
}

/** What a run says of its frames, without the first of them. */
function without<T extends Run | ObjectRun>(run: T, drop: number): T {
  return { ...run, firstFrame: run.firstFrame + drop, finalCount: Math.max(run.finalCount - drop, 0) };
}
