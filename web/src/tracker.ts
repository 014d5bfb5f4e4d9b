// SPDX-License-Identifier: Apache-2.0
import { batch, computed, type ReadonlySignal, signal } from "@preact/signals";
import { Connection, type Link, type Observer, type World } from "./connection";
import { inOwnPixels, type Table } from "./exports/table";
import { Figures } from "./figures";
import { FrameStore } from "./frames";
import { Playback } from "./playback";
import { Points, type Shape } from "./points";
import { type Answer, SessionState } from "./session";
import { sessionConfig, type Settings } from "./settings";
import type { Source } from "./sources/source";
import { TrackStore } from "./tracks";
import { inWords, objectPointId, type ObjectRun, type Run, type SessionAccepted } from "./wire";

/**
 * empty -> loading -> ready -> running <-> paused -> finishing -> done; failed from any of them. A run can begin anew
 * from each that comes after ready.
 */
export type Phase = "empty" | "loading" | "ready" | "running" | "paused" | "finishing" | "done" | "failed";

export interface Notice {
  text: string;
  bad: boolean;
}

/** Follows points through the frames of a source: what the user does, what the server says, and what there is to see. */
export class Tracker implements Observer {
  readonly phase = signal<Phase>("empty");
  readonly link = signal<Link | null>(null);
  readonly notice = signal<Notice | null>(null);
  readonly source = signal<Source | null>(null);
  readonly accepted = signal<SessionAccepted | null>(null);
  readonly loaded = signal(0); // frames that the source has given
  readonly sent = signal(0);
  readonly processed = signal(0);
  readonly final = signal(0);
  readonly dropped = signal(0);
  readonly shown = signal(-1); // the frame on the stage
  readonly following = signal(true); // it is the newest one sent
  readonly revision = signal(0); // of points and tracks
  /** Points or objects were placed on frames that had been sent: they are followed when the run begins anew. */
  readonly stale = signal(false);
  readonly active = computed(() => ["running", "paused", "finishing"].includes(this.phase.value));

  private readonly over = computed(() => this.phase.value === "done");
  /** Frames that there are to see. */
  readonly there = computed(() => (this.over.value ? this.sent.value : this.loaded.value));
  /** Frames that there will be, as far as is known. */
  readonly expected = computed(() => Math.max(this.there.value, this.over.value ? 0 : (this.source.value?.frames ?? 0)));

  readonly frames = new FrameStore();
  readonly points = new Points();
  tracks = new TrackStore();
  figures = new Figures();
  private readonly playback: Playback;
  private session: SessionState | null = null;
  private connection: Connection | null = null;
  private wakers: (() => void)[] = [];
  private stopping = false;
  private held = false;
  private loads = 0; // so many sources were asked for
  private lastSent = -Infinity;

  constructor(
    private readonly world: World,
    private readonly settings: () => Settings,
  ) {
    this.playback = new Playback(this.frames, this.shown, this.there, world);
  }

  /** Frames that were sent before are shown one after the other. */
  get playing(): ReadonlySignal<boolean> {
    return this.playback.playing;
  }

  // --- What the user does.

  /** Takes another source, and shows its first frame. A live one starts at once. */
  async load(open: () => Promise<Source>): Promise<void> {
    this.close();
    this.phase.value = "loading";
    const load = ++this.loads;
    let source: Source | null = null;
    try {
      source = await open();
      const picture = await source.next();
      if (!picture) throw new Error(`${source.label} has no frames.`);
      if (load !== this.loads) return source.close(); // another one was asked for meanwhile
      this.frames.add(picture.jpeg, picture.seconds);
      await this.frames.bitmap(0);
      if (load !== this.loads) return source.close();
    } catch (error) {
      source?.close();
      if (load !== this.loads) return;
      this.phase.value = "empty";
      this.fail(error);
      return;
    }
    batch(() => {
      this.source.value = source;
      this.loaded.value = 1;
      this.shown.value = 0;
      this.phase.value = "ready";
    });
    if (source.live) this.start();
  }

  /** Begins a run, from the first frame on. */
  start(): void {
    const source = this.source.value;
    if (!source || this.phase.value === "loading") return;
    if (this.frames.first > 0) {
      return this.say("The first frames of this run are not kept any more: it cannot begin anew.", true);
    }
    this.endSession();
    this.playback.stop();
    this.tracks = new TrackStore();
    this.figures = new Figures();
    for (const made of [...this.points.all, ...this.points.objects].sort((a, b) => a.id - b.id)) {
      if ("placed" in made) this.tracks.seed(made.id, made.placed[0]!.frame).name = made.name;
      else this.tracks.seedObject(made.id, made.frame).given = made.name;
    }
    this.session = new SessionState(sessionConfig(this.settings(), { width: source.width, height: source.height }));
    this.connection = new Connection(this.session, this.world, this);
    batch(() => {
      this.phase.value = "running";
      this.sent.value = this.processed.value = this.final.value = 0;
      this.stale.value = this.stopping = false;
      this.follow();
      this.touch();
    });
    this.connection.start();
    void this.pump(this.session, this.connection);
  }

  /** Starts, pauses or goes on; after a run, plays what there is. */
  toggle(): void {
    const phase = this.phase.value;
    if (phase === "ready" || phase === "failed") return this.start();
    if (phase === "running") return this.pause();
    if (phase === "paused") return this.goOn();
    if (phase === "done") this.playback.toggle();
  }

  pause(): void {
    if (this.phase.value === "running") this.phase.value = "paused";
  }

  goOn(): void {
    if (this.phase.value !== "paused") return;
    this.phase.value = "running";
    this.source.value?.skip?.();
    this.follow();
    this.wake();
  }

  /** No more frames are sent; everything becomes final. */
  stop(): void {
    if (this.phase.value !== "running" && this.phase.value !== "paused") return;
    this.stopping = true;
    this.endLive();
    this.phase.value = "finishing";
    this.wake();
  }

  retryNow(): void {
    this.connection?.retryNow();
  }

  /** Places new points on the frame that is shown. */
  add(positions: readonly { x: number; y: number }[]): number[] {
    const frame = this.shown.value;
    if (frame < 0 || !this.source.value) return [];
    if (!this.hasRoom(positions.length, 0)) return [];
    const seeds = positions.map((at) => this.points.add(frame, ...this.inside(at)));
    for (const { id } of seeds) this.tracks.seed(id, frame).waits = !this.takes(frame);
    this.tell(frame, seeds.map(({ id }) => id));
    return seeds.map(({ id }) => id);
  }

  /** While something is drawn no frame is sent, and none is played, so that it is of the one that is shown. */
  hold(held: boolean): void {
    if (this.held && !held) this.source.value?.skip?.();
    this.held = held;
    held ? this.playback.stop() : this.wake();
  }

  /**
   * An object, as it was drawn on the frame that is shown. A server takes objects with a frame: where that one was the
   * newest sent, the object begins on the next. Null: there is no room for it.
   */
  addObject(shape: Shape, count: number): number | null {
    const shown = this.shown.value;
    if (shown < 0 || !this.source.value || !this.hasRoom(count, 1)) return null;
    const newest = this.sent.value - 1;
    const frame = shown === newest && this.takesMore ? shown + 1 : shown;
    const { id } = this.points.addObject({ frame, shown, shape, count });
    this.tracks.seedObject(id, frame).waits = !this.takes(frame);
    if (frame <= newest) this.stale.value = true;
    this.touch();
    return id;
  }

  /** Says where a point is on the frame that is shown: it is followed from there on. */
  place(id: number, at: { x: number; y: number }): void {
    const frame = this.shown.value;
    this.points.place(id, frame, ...this.inside(at));
    if (this.takes(frame)) this.tracks.seed(id, frame).waits = false;
    this.tell(frame, [id]);
  }

  /** Points or objects. */
  remove(ids: readonly number[]): void {
    const told = ids.flatMap((id) => this.pointIds(id));
    for (const id of ids) {
      this.points.remove(id);
      this.tracks.remove(id);
    }
    if (this.sent.value > 0 && this.active.value && !this.stopping) {
      this.session?.removePoints(told);
      this.connection?.flush();
    }
    this.touch();
  }

  /** A point or an object; "" takes its name away. */
  rename(id: number, name: string): void {
    const [made, track, object] = [this.points.get(id) ?? this.points.getObject(id), this.tracks.get(id), this.tracks.getObject(id)];
    if (made) made.name = name;
    if (track) track.name = name;
    if (object) object.given = name;
    this.touch();
  }

  /** Shows a frame that was there before. */
  show(frame: number): void {
    const newest = this.there.value - 1;
    batch(() => {
      this.playback.stop();
      this.shown.value = Math.min(Math.max(frame, this.frames.first), newest);
      this.following.value = this.active.value && this.shown.value === this.sent.value - 1;
    });
  }

  /** Shows the newest frame sent, and those to come. */
  follow(): void {
    this.playback.stop();
    this.following.value = true;
    this.shown.value = Math.max(0, this.sent.value - 1);
  }

  say(text: string, bad = false): void {
    this.notice.value = { text, bad };
  }

  /** What files of the tracks are made of, in pixels of the source's own frames. */
  table(): Table {
    const [table, source] = [this.tableAsSent(), this.source.value];
    return source ? inOwnPixels(table, source) : table;
  }

  /** The same in pixels of the frames sent, which are what there is to paint on. */
  tableAsSent(): Table {
    const [tracks, objects] = [followed(this.tracks.tracks), followed(this.tracks.objects)];
    const complete = this.phase.value === "done";
    const frames = complete ? this.sent.value : Math.max(0, ...tracks.map((track) => track.end));
    const { width = 0, height = 0, live = false, fps = 30 } = this.source.value ?? {};
    const expectedFrames = complete ? frames : Math.max(this.source.value?.frames ?? 0, this.sent.value, frames);
    const measured = live && Number.isFinite(this.frames.fps) ? this.frames.fps : fps;
    const finalFrames = this.tracks.finalFrames(frames);
    const goesOn = (this.source.value?.frames ?? 0) > frames;
    return { tracks, objects, width, height, fps: measured, frames, complete, finalFrames, expectedFrames, goesOn };
  }

  // --- What the server says.

  onLink(link: Link): void {
    this.link.value = link;
    if (link.state === "ended" && link.problem) this.fail(new Error(inWords(link.problem)));
    this.wake();
  }

  onAccepted(accepted: SessionAccepted, resumed: boolean): void {
    this.accepted.value = accepted;
    if (resumed) this.say(`The session goes on at frame ${accepted.firstFrame}.`);
    this.wake();
  }

  onAnswer(answer: Answer): void {
    if (answer.kind === "tracks") this.takeTracks(answer.runs, answer.objects, answer.processed);
    if (answer.kind === "warning") this.say(answer.text, true);
    if (answer.kind === "goingAway") this.say(`The server is about to stop, in ${answer.seconds} s at the latest.`);
    if (answer.kind === "summary") {
      this.bringBackObjects();
      batch(() => {
        this.phase.value = "done";
        this.following.value = false;
        this.touch();
      });
    }
    this.wake();
  }

  onRoom(): void {
    this.wake();
  }

  private takeTracks(runs: Run[], objects: ObjectRun[], processed: number): void {
    const now = this.world.now();
    this.tracks.apply(runs, objects);
    for (const run of runs) this.figures.answered(run.firstFrame, run.firstFrame + run.x.length - 1, now);
    this.figures.processed(processed, now);
    batch(() => {
      this.processed.value = processed;
      this.touch();
    });
  }

  // --- Frames on their way.

  private async pump(session: SessionState, connection: Connection): Promise<void> {
    try {
      while (await this.turn(session, connection)) {
        const frame = session.frames;
        if (!(await this.fetch(frame))) break;
        await this.keepPace(frame);
        if (this.session !== session) return;
        if (this.phase.value === "running" && !this.held) this.sendFrame(session, connection, frame);
      }
      if (this.session !== session || this.phase.value === "failed") return;
      this.phase.value = "finishing";
      session.finish();
      connection.flush();
    } catch (error) {
      if (this.session !== session) return;
      connection.stop();
      this.fail(error);
    }
  }

  // Waits until a frame may be sent. False: there is none to send any more.
  private async turn(session: SessionState, connection: Connection): Promise<boolean> {
    const over = () => this.session !== session || this.stopping || this.phase.value === "failed";
    while (!over() && !(this.phase.value === "running" && !this.held && this.wantsFrame(session, connection))) {
      await new Promise<void>((resolve) => this.wakers.push(resolve));
    }
    return !over();
  }

  // A live source is asked for no frame while all of another one waits for the network: it would be old before it left.
  private wantsFrame(session: SessionState, connection: Connection): boolean {
    if (!session.wantsFrame) return false;
    const newest = this.source.value!.live ? this.frames.jpeg(session.frames - 1) : null;
    return !newest || connection.hasRoom(newest.length);
  }

  // The frame is in the store, with its bitmap at hand. False: the source has ended.
  private async fetch(frame: number): Promise<boolean> {
    while (this.frames.count <= frame) {
      const source = this.source.value!;
      const picture = await source.next();
      if (source !== this.source.value || !picture) return false;
      this.frames.add(picture.jpeg, picture.seconds);
      batch(() => {
        this.loaded.value = this.frames.count;
        this.dropped.value = source.dropped;
      });
    }
    await this.frames.bitmap(frame);
    return true;
  }

  // A camera has its own. Where nobody looks there is no pace to be kept.
  private async keepPace(frame: number): Promise<void> {
    if (frame === 0 || this.source.value?.live || this.settings().pace === "fastest" || this.world.hidden()) return;
    const step = 1000 * (this.frames.seconds(frame) - this.frames.seconds(frame - 1));
    const wait = this.lastSent + step - this.world.now();
    if (wait > 0) await new Promise<void>((resolve) => this.world.after(wait, resolve));
  }

  private sendFrame(session: SessionState, connection: Connection, frame: number): void {
    const jpeg = this.frames.jpeg(frame);
    if (!jpeg) return;
    this.lastSent = this.world.now();
    session.pushFrame(jpeg, this.points.seedsOn(frame), this.points.objectsOn(frame));
    connection.flush();
    this.figures.sent(frame, this.lastSent);
    batch(() => {
      this.sent.value = session.frames;
      if (this.following.value) this.shown.value = frame;
    });
  }

  // Lets the session know of points on a frame: at once, with the frame that is yet to be sent, or not in this run.
  private tell(frame: number, ids: number[]): void {
    const newest = this.sent.value - 1;
    if (frame === newest && this.takesMore) {
      this.session?.addPoints(this.points.seedsOn(frame).filter(({ id }) => ids.includes(id)));
      this.connection?.flush();
    } else if (frame <= newest) {
      this.stale.value = true;
    }
    this.touch();
  }

  // The session still hears of what is placed.
  private get takesMore(): boolean {
    return this.active.value && !this.stopping && this.phase.value !== "finishing";
  }

  // What is placed on this frame is followed by the run that is on, or is the first one to come.
  private takes(frame: number): boolean {
    return this.phase.value === "ready" || (this.takesMore && frame >= this.sent.value - 1);
  }

  private hasRoom(points: number, objects: number): boolean {
    const { maxPoints = Infinity, maxObjects = Infinity } = this.accepted.value?.limits ?? {};
    const full = this.points.most + points > maxPoints ? `${maxPoints} points`
      : this.points.objectCount + objects > maxObjects ? `${maxObjects} objects` : null;
    if (full) this.say(`This server follows at most ${full} in a session.`, true);
    return !full;
  }

  // Of a point, or of all that an object may have, as messages have them.
  private pointIds(id: number): number[] {
    const object = this.points.getObject(id);
    return object ? Array.from({ length: object.count }, (_, i) => objectPointId(id, i)) : [id];
  }

  // Objects that were to begin on the frame after what became the last one.
  private bringBackObjects(): void {
    for (const object of this.points.objects) {
      if (object.frame < this.sent.value) continue;
      object.frame = object.shown;
      this.tracks.getObject(object.id)!.waits = true;
      this.stale.value = true;
    }
  }

  // --- Beginnings and ends.

  private inside({ x, y }: { x: number; y: number }): [number, number] {
    const { width, height } = this.source.value!;
    return [Math.min(Math.max(x, 0), width - 1), Math.min(Math.max(y, 0), height - 1)];
  }

  private fail(error: unknown): void {
    if (this.source.value) this.phase.value = "failed";
    if (this.session?.accepted) this.endLive(); // otherwise it has not begun, and is tried again
    this.say(error instanceof Error ? error.message : String(error), true);
    this.wake();
  }

  // A camera is on no longer than its frames are wanted.
  private endLive(): void {
    if (this.source.value?.live) this.source.value.close();
  }

  private touch(): void {
    this.final.value = this.tracks.finalFrames(this.sent.value);
    ++this.revision.value;
  }

  private wake(): void {
    const wakers = this.wakers;
    this.wakers = [];
    for (const wake of wakers) wake();
  }

  private endSession(): void {
    const connection = this.connection;
    this.session = this.connection = null;
    connection?.stop();
    this.wake();
  }

  private close(): void {
    this.endSession();
    this.held = false;
    this.source.value?.close();
    this.frames.clear();
    this.points.clear();
    this.tracks = new TrackStore();
    this.figures = new Figures();
    batch(() => {
      this.source.value = this.link.value = this.accepted.value = this.notice.value = null;
      this.loaded.value = this.sent.value = this.processed.value = this.dropped.value = 0;
      this.playback.stop();
      this.stale.value = false;
      this.following.value = true;
      this.shown.value = -1;
      this.phase.value = "empty";
      this.touch();
    });
  }
}

const followed = <T extends { waits: boolean }>(all: Iterable<T>): T[] => [...all].filter(({ waits }) => !waits);
