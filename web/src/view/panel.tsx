// SPDX-License-Identifier: Apache-2.0
import type { ComponentChildren } from "preact";
import { signal } from "@preact/signals";
import { colorOf } from "../draw";
import { noOverlay, toWebm } from "../exports/overlay";
import { toCvat } from "../exports/cvat";
import { toNpz } from "../exports/npz";
import { to3de, toCsv, toDeepLabCut, toJson } from "../exports/text";
import type { ObjectTrack } from "../objects";
import * as page from "../page";
import type { Position } from "../points";
import { toOwnPixels } from "../sources/source";
import { LatencyChart, LoadChart, RateChart } from "./chart";
import { LeftMark } from "./help";
import { Icon, IconButton } from "./icons";

const { tracker, server, settings } = page;

function Card({ title, open, beside, children }: {
  title: string;
  open?: boolean;
  beside?: ComponentChildren; // its title, also while it is closed
  children: ComponentChildren;
}) {
  return (
    <details class="card" open={open}>
      <summary><h2>{title}</h2>{beside}</summary>
      <div class="card-body">{children}</div>
    </details>
  );
}

const number = (value: number, digits = 0) => (Number.isFinite(value) ? value.toFixed(digits) : "–");
const time = (ms: number) => (ms >= 1000 ? `${number(ms / 1000, 1)} s` : Number.isFinite(ms) ? `${number(ms)} ms` : "–");

function Figure({ name, value, hint }: { name: string; value: string; hint: string }) {
  return (
    <div class="figure" title={hint}>
      <dt>{name}</dt>
      <dd>{value}</dd>
    </div>
  );
}

function Progress({ name, value, of }: { name: string; value: number; of: number }) {
  const share = of > 0 ? Math.min(1, value / of) : 0;
  return (
    <div class="progress">
      <span>{name}</span>
      <span class="track" aria-hidden="true"><span class={`bar ${name}`} style={{ width: `${100 * share}%` }} /></span>
      <output data-figure={name}>{value}</output>
    </div>
  );
}

function Live() {
  void tracker.revision.value;
  const { figures } = tracker;
  const sent = tracker.sent.value;
  const all = tracker.expected.value;
  return (
    <Card title="Progress" open beside={figures.rates.length > 0 && <><RateChart /><span class="load-now">frames/s</span></>}>
      <Progress name="sent" value={sent} of={all} />
      <Progress name="processed" value={tracker.processed.value} of={all} />
      <Progress name="final" value={tracker.final.value} of={all} />
      <dl class="figures">
        <Figure name="frames/s" value={number(figures.rate(performance.now()), 1)} hint="Frames that the server worked off, over the last three seconds" />
        <Figure name="p50" value={time(figures.latency(0.5))} hint="Half of the newest frames had an estimate within this time" />
        <Figure name="p95" value={time(figures.latency(0.95))} hint="95 of 100 of the newest frames had an estimate within this time" />
        <Figure name="dropped" value={String(tracker.dropped.value)} hint="Frames of the camera that came while the server was busy" />
      </dl>
      <p class="soft caption">Latency of a frame's first estimate</p>
      <LatencyChart />
    </Card>
  );
}

// A position as files have it.
function placeOf({ x, y }: Position): string {
  const own = toOwnPixels(tracker.source.value!);
  return `${own.x(x).toFixed(2)}, ${own.y(y).toFixed(2)}`;
}

function Facts({ facts }: { facts: [string, string | undefined][] }) {
  const known = facts.filter(([, value]) => value);
  return <dl class="facts">{known.map(([name, value]) => [<dt key={name}>{name}</dt>, <dd key={`${name}:`} title={value}>{value}</dd>])}</dl>;
}

function Selected() {
  void tracker.revision.value;
  const id = page.selected.value;
  const point = id === null ? undefined : tracker.points.get(id);
  const track = id === null ? undefined : tracker.tracks.get(id);
  if (!point || !track) {
    const count = tracker.points.size;
    return (
      <Card title="Point" open>
        <p class="soft">{count === 0 ? "Click in the picture to place one." : `${count === 1 ? "1 point" : `${count} points`}; click one to select it.`}</p>
      </Card>
    );
  }
  const frame = track.newest(tracker.shown.value);
  const sample = track.at(frame);
  const state = sample ? `${sample.visible ? "seen" : "hidden"}, ${sample.final ? "final" : "provisional"}` : "not followed yet";
  return (
    <Card title="Point" open>
      <div class="point-head">
        <i class="dot" style={{ background: colorOf(track) }} />
        <input aria-label="Name of the point" value={track.name} maxLength={64} spellcheck={false}
          onChange={(event) => tracker.rename(point.id, event.currentTarget.value.trim())} />
        <IconButton icon="bin" name="Remove this point" keys="Del" onClick={page.removeSelected} />
      </div>
      <Facts facts={[
        ["frame", sample ? String(frame) : "–"],
        ["position", sample ? placeOf(sample) : "–"],
        ["confidence", sample ? sample.confidence.toFixed(3) : "–"],
        ["state", state],
        ["placed on", point.placed.map(({ frame }) => frame).join(", ")],
      ]} />
    </Card>
  );
}

function ObjectEntry({ object }: { object: ObjectTrack }) {
  void tracker.revision.value;
  const { id, name } = object;
  const frame = object.newest(tracker.shown.value);
  const sample = object.at(frame);
  const chosen = page.selected.value === id;
  const share = sample ? Math.round(100 * sample.visible) : 0;
  return (
    <li class={chosen ? "chosen" : ""} onPointerEnter={() => (page.hovered.value = id)} onPointerLeave={() => (page.hovered.value = null)}>
      <button type="button" class="object-name" aria-pressed={chosen} onClick={() => (page.selected.value = chosen ? null : id)}>
        <i class="swatch" style={{ background: colorOf(object) }} />{name}
      </button>
      <span class="track" aria-hidden="true"><span class="bar share" style={{ width: `${share}%`, background: colorOf(object) }} /></span>
      <span class="seen" title="Share of it that is in sight">{sample ? `${share} %` : "–"}</span>
      <span class="left" title="Points that do not move with it any more">{sample && <><LeftMark />{sample.left.length} left</>}</span>
      <IconButton icon="bin" name={`Remove ${name}`} onClick={() => page.remove(id)} />
    </li>
  );
}

function ObjectFacts({ object }: { object: ObjectTrack }) {
  void tracker.revision.value;
  const frame = object.newest(tracker.shown.value);
  const sample = object.at(frame);
  return (
    <>
      <div class="point-head">
        <i class="swatch" style={{ background: colorOf(object) }} />
        <input aria-label="Name of the object" value={object.name} maxLength={64} spellcheck={false}
          onChange={(event) => tracker.rename(object.id, event.currentTarget.value.trim())} />
      </div>
      {sample && <Facts facts={[
        ["frame", `${frame}, ${sample.final ? "final" : "provisional"}`],
        ["centre", placeOf(sample)],
        ["size since drawn", `× ${sample.scale.toFixed(3)}`],
        ["turned", `${(Math.round((1800 * sample.rotation) / Math.PI) / 10 || 0).toFixed(1)}°`],
      ]} />}
    </>
  );
}

function Objects() {
  void tracker.revision.value;
  const objects = [...tracker.tracks.objects];
  const selected = objects.find(({ id }) => id === page.selected.value);
  return (
    <Card title="Objects" open>
      {objects.length === 0 ? <p class="soft">Brush over one (<kbd>B</kbd>), or click its corners (<kbd>O</kbd>), to follow it as a group.</p>
        : <ul class="objects">{objects.map((object) => <ObjectEntry key={object.id} object={object} />)}</ul>}
      {selected && <ObjectFacts object={selected} />}
    </Card>
  );
}

const rendering = signal<number | null>(null); // share of the overlay that is done

function save(name: string, type: string, content: string | Uint8Array<ArrayBuffer>): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

async function saveOverlay(): Promise<void> {
  rendering.value = 0;
  try {
    save("overlay.webm", "video/webm", await toWebm(tracker.tableAsSent(), tracker.frames, settings.value, (share) => (rendering.value = share)));
  } catch (error) {
    tracker.say(`The video cannot be made: ${error instanceof Error ? error.message : error}`, true);
  } finally {
    rendering.value = null;
  }
}

function Exports() {
  void tracker.revision.value;
  const nothing = tracker.sent.value === 0 || tracker.points.most === 0;
  const obstacle = noOverlay();
  const share = rendering.value;
  const buttons: [string, string, () => void][] = [
    ["JSON", "Tracks by point, objects, and how complete they are", () => save("tracks.json", "application/json", toJson(tracker.table()))],
    ["CSV", "A line a point and frame", () => save("tracks.csv", "text/csv", toCsv(tracker.table()))],
    ["NumPy", "Arrays: tracks, visible, confidence, ids (.npz)", () => save("tracks.npz", "application/zip", toNpz(tracker.table()) as Uint8Array<ArrayBuffer>)],
    ["DeepLabCut", "A row a frame, for DeepLabCut, napari and movement (.dlc.csv)", () => save("tracks.dlc.csv", "text/csv", toDeepLabCut(tracker.table()))],
    ["CVAT", "A track a point, for CVAT for video 1.1 (.xml)", () => save("tracks.xml", "application/xml", toCvat(tracker.table()))],
    ["3DEqualizer", "2D tracks from the lower left corner, for 3DEqualizer, Nuke and Blender (.3de.txt)", () => save("tracks.3de.txt", "text/plain", to3de(tracker.table()))],
  ];
  return (
    <Card title="Export" open>
      <div class="buttons">
        {buttons.map(([name, title, run]) => (
          <button type="button" key={name} title={title} disabled={nothing} onClick={run}><Icon name="download" />{name}</button>
        ))}
        <button type="button" class="wide" disabled={nothing || obstacle !== null || share !== null} title={obstacle ?? "The video with the tracks drawn on it (.webm)"} onClick={() => void saveOverlay()}>
          <Icon name="film" />{share === null ? "Video with tracks" : `Rendering ${Math.round(100 * share)} %`}
        </button>
      </div>
    </Card>
  );
}

function Choice({ label, hint, value, options, onPick }: {
  label: string;
  hint: string;
  value: string | number;
  options: [string | number, string][];
  onPick: (value: string) => void;
}) {
  const known = options.some(([option]) => String(option) === String(value));
  return (
    <label class="field" title={hint}>
      <span>{label}</span>
      <select value={String(value)} onChange={(event) => onPick(event.currentTarget.value)}>
        {!known && <option value={String(value)}>{value}</option>}
        {options.map(([option, text]) => <option key={option} value={String(option)}>{text}</option>)}
      </select>
    </label>
  );
}

const ON_OFF: [string, string][] = [["", "server's default"], ["on", "on"], ["off", "off"]];

function Options() {
  const { size, hop, iterations, live, prior, polish, side, quality, pace, trail } = settings.value;
  const numbers = (list: number[]): [number, string][] => [[0, "server's default"], ...list.map((n): [number, string] => [n, String(n)])];
  return (
    <Card title="Settings">
      <p class="soft">They count from the next start on, and are kept in the page's address.</p>
      <Choice label="Processing size" hint="Frames are resized to it: larger ones show more, and cost more" value={size}
        options={[["", "server's default"], ["256x192", "256 × 192"], ["384x288", "384 × 288"], ["512x384", "512 × 384"], ["640x384", "640 × 384"], ["768x576", "768 × 576"]]} onPick={(value) => page.change({ size: value })} />
      <Choice label="Frames between windows" hint="Fewer revise estimates more often" value={hop} options={numbers([4, 8, 12, 16, 23])} onPick={(value) => page.change({ hop: Number(value) })} />
      <Choice label="Iterations" hint="Refinements of a window" value={iterations} options={numbers([1, 2, 3, 4, 6, 8])} onPick={(value) => page.change({ iterations: Number(value) })} />
      <Choice label="Estimates" hint="On every frame: what optical flow says, at once" value={live ? "1" : "0"} options={[["1", "on every frame"], ["0", "with each window"]]} onPick={(value) => page.change({ live: value === "1" })} />
      <Choice label="Motion prior" hint="Windows start where optical flow leads" value={prior} options={ON_OFF} onPick={(value) => page.change({ prior: value })} />
      <Choice label="Polish" hint="Final positions are moved to where the picture says" value={polish} options={ON_OFF} onPick={(value) => page.change({ polish: value })} />
      <Choice label="Longest side sent" hint="Larger frames are shrunk before they are sent. Counts from the next source on" value={side} options={[[512, "512 px"], [768, "768 px"], [1024, "1024 px"], [1920, "1920 px"], [0, "as it is"]]} onPick={(value) => page.change({ side: Number(value) })} />
      <Choice label="JPEG quality" hint="Counts from the next source on" value={quality} options={[[75, "75"], [90, "90"], [95, "95"], [100, "100"]]} onPick={(value) => page.change({ quality: Number(value) })} />
      <Choice label="Pace of files" hint="How fast frames of files are sent" value={pace} options={[["recorded", "as recorded"], ["fastest", "as fast as the server"]]} onPick={(value) => page.change({ pace: value as "recorded" | "fastest" })} />
      <Choice label="Trails" hint="How many frames a trail is long" value={trail} options={[[0, "none"], [12, "12 frames"], [24, "24 frames"], [48, "48 frames"], [120, "120 frames"]]} onPick={(value) => page.change({ trail: Number(value) })} />
    </Card>
  );
}

export function ServerPill() {
  const standing = server.standing.value;
  return (
    <span class={`pill ${standing}`} role="status" title={server.words.value}>
      <i aria-hidden="true" />
      <span>{server.words.value}</span>
    </span>
  );
}

function Server() {
  const info = server.info.value;
  const standing = server.standing.value;
  const size = info?.defaultProcessingSize;
  const accepted = tracker.accepted.value;
  const facts: [string, string | undefined][] = info ? [
    ["model", info.modelName],
    ["preset", info.preset],
    ["weights", info.weightsSha256?.slice(0, 12)],
    ["device", [info.device, info.precision].filter(Boolean).join(", ")],
    ["version", info.build],
    ["processing size", size && `${size.width} × ${size.height}`],
    ["window, hop", `${info.windowFrames} frames, ${info.defaultHopFrames}`],
    ["sessions", `${info.load?.sessions ?? 0} of ${info.maxSessions}`],
    ["points", `${info.load?.points ?? 0}; ${info.limits?.maxPoints} a session`],
  ] : [];
  if (accepted) facts.push(["this session", accepted.sessionId], ["its trace", accepted.traceId]);
  return (
    <Card title="Server" open={standing === "token"} beside={<LoadChart />}>
      {standing !== "serving" && <p class="soft">{server.words.value}.</p>}
      <Facts facts={facts} />
      <form class="field" onSubmit={(event) => { event.preventDefault(); void server.ask(); }}>
        <label for="token">Token</label>
        <input id="token" type="password" autocomplete="off" placeholder="none" value={page.token.value}
          onChange={(event) => { page.token.value = event.currentTarget.value.trim(); void server.ask(); }} />
      </form>
    </Card>
  );
}

export function Panel() {
  const locked = server.standing.value === "token"; // what to do about it comes first
  return (
    <aside class="panel" aria-label="Figures, settings and files">
      {locked && <Server />}
      <Live />
      <Selected />
      <Objects />
      <Exports />
      <Options />
      {!locked && <Server />}
    </aside>
  );
}
