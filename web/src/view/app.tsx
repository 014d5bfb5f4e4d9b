// SPDX-License-Identifier: Apache-2.0
import { useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import * as page from "../page";
import { LEAST_CORNERS } from "../polygon";
import { noCamera } from "../sources/camera";
import { Help, Marks } from "./help";
import { Icon, IconButton, type IconName } from "./icons";
import { Panel, ServerPill } from "./panel";
import { Stage } from "./stage";
import { Timeline } from "./timeline";

const { tracker } = page;
const NOTICE_MS = 8_000;

function FilePicker({ icon, name, accept, multiple }: { icon: IconName; name: string; accept: string; multiple?: boolean }) {
  const input = useRef<HTMLInputElement>(null);
  const pick = () => {
    page.loadFiles([...(input.current!.files ?? [])]);
    input.current!.value = ""; // so that the same file can be taken again
  };
  return (
    <>
      <button type="button" onClick={() => input.current!.click()}><Icon name={icon} /><span>{name}</span></button>
      <input ref={input} class="hidden" type="file" aria-label={name} tabIndex={-1} accept={accept} multiple={multiple} onChange={pick} />
    </>
  );
}

function Sources() {
  const obstacle = noCamera();
  return (
    <div class="sources" role="group" aria-label="Source of frames">
      <button type="button" onClick={() => void page.loadClip()}><Icon name="film" /><span>Sample clip</span></button>
      <FilePicker icon="file" name="Video" accept="video/*,.mkv" />
      <FilePicker icon="pictures" name="Pictures" accept="image/jpeg,image/png" multiple />
      <button type="button" disabled={obstacle !== null} title={obstacle ?? ""} onClick={() => void page.loadCamera()}><Icon name="camera" /><span>Camera</span></button>
    </div>
  );
}

function Header() {
  const dark = page.theme.value === "dark";
  return (
    <header class="top">
      <h1><img src="icon.svg" alt="" width="26" height="26" />Holdfast</h1>
      <Sources />
      <span class="spring" />
      <ServerPill />
      <IconButton icon={dark ? "sun" : "moon"} name={dark ? "Light colours" : "Dark colours"} keys="D" onClick={page.changeTheme} />
      <IconButton icon="help" name="Help" keys="?" onClick={() => (page.helpOpen.value = true)} />
    </header>
  );
}

function Welcome() {
  const phase = tracker.phase.value;
  if (phase === "loading") return <div class="welcome" role="status"><p>Reading the first frame …</p></div>;
  return (
    <div class="welcome">
      <h2>Follow any point through video</h2>
      <p>Click on what matters, press start, and watch it being followed, live. Drop a video here, or begin with the clip.</p>
      <button type="button" class="primary" onClick={() => void page.loadClip()}><Icon name="film" />Open the sample clip</button>
    </div>
  );
}

/** What to do with an outline that has been begun. */
function Outlining() {
  const count = page.corners.value.length;
  return (
    <div class="hint outlining">
      <span>{count < LEAST_CORNERS ? "Click the next corner" : "Click the first corner again to close"}{tracker.active.value && ", meanwhile frames wait"}.</span>
      <IconButton icon="undo" name="Take the last corner back" keys="Backspace" onClick={page.takeCornerBack} />
      <IconButton icon="check" name="Close the outline" keys="Enter" disabled={count < LEAST_CORNERS} onClick={page.closeOutline} />
      <IconButton icon="close" name="Give up the outline" keys="Esc" onClick={page.dropOutline} />
    </div>
  );
}

function Hint() {
  if (page.corners.value.length > 0) return <Outlining />;
  const phase = tracker.phase.value;
  if (phase === "empty" || phase === "loading" || (tracker.revision.value, tracker.points.most) > 0) return null;
  if (phase !== "ready") return <p class="hint">Nothing is followed yet: click on what you want to follow.</p>;
  return <p class="hint">Click on what you want to follow, or brush over an object. <kbd>Space</kbd> starts.</p>;
}

/** What became of the connection, when that is not what it should be. */
function Banner() {
  const link = tracker.link.value;
  const now = useSignal(performance.now());
  useEffect(() => {
    const timer = setInterval(() => (now.value = performance.now()), 250);
    return () => clearInterval(timer);
  }, []);
  const lost = tracker.active.value && (link?.state === "waiting" || (link?.state === "connecting" && tracker.accepted.value));
  if (!lost) return null;
  const seconds = link.state === "waiting" ? Math.max(0, Math.ceil((link.until - now.value) / 1000)) : 0;
  return (
    <div class="banner" role="alert">
      <span class="spinner" aria-hidden="true" />
      <p><strong>The server is lost.</strong> {link.state === "waiting" ? `Trying again in ${seconds} s.` : "Trying again …"} What it has not seen is kept and sent again.</p>
      <button type="button" onClick={() => tracker.retryNow()}>Try now</button>
    </div>
  );
}

function Notice() {
  const notice = tracker.notice.value;
  useSignalEffect(() => {
    const shown = tracker.notice.value;
    if (!shown || shown.bad) return;
    const timer = setTimeout(() => tracker.notice.value === shown && (tracker.notice.value = null), NOTICE_MS);
    return () => clearTimeout(timer);
  });
  if (!notice) return null;
  return (
    <div class={`notice ${notice.bad ? "bad" : ""}`} role={notice.bad ? "alert" : "status"}>
      <p>{notice.text}</p>
      <IconButton icon="close" name="Close the message" onClick={() => (tracker.notice.value = null)} />
    </div>
  );
}

/** Points that this run came too late for. */
function Stale() {
  if (!tracker.stale.value || tracker.source.value?.live && tracker.active.value) return null;
  return (
    <div class="notice" role="status">
      <p>What was placed on frames sent before is followed when the run begins anew.</p>
      <button type="button" onClick={() => tracker.start()}>Track again</button>
    </div>
  );
}

const START: Record<string, [IconName, string]> = {
  ready: ["play", "Start"],
  running: ["pause", "Pause"],
  paused: ["play", "Go on"],
  finishing: ["play", "Finishing"],
  failed: ["again", "Retry"],
  done: ["play", "Play"],
};

function Transport() {
  const phase = tracker.phase.value;
  const [icon, name] = phase === "done" && tracker.playing.value ? (["pause", "Pause"] as const) : (START[phase] ?? ["play", "Start"]);
  const newest = tracker.there.value - 1;
  const none = phase === "empty" || phase === "loading";
  const shown = tracker.shown.value;
  return (
    <div class="transport" role="toolbar" aria-label="Run">
      <button type="button" class="primary" disabled={none || phase === "finishing"} title={`${name} (Space)`} onClick={() => tracker.toggle()}><Icon name={icon} />{name}</button>
      <IconButton icon="stop" name="Stop: everything becomes final" keys="S" disabled={phase !== "running" && phase !== "paused"} onClick={() => tracker.stop()} />
      <IconButton icon="again" name="Track again from the first frame" keys="R" disabled={none || phase === "ready"} onClick={() => tracker.start()} />
      <span class="gap" />
      <IconButton icon="previous" name="One frame back" keys="←" disabled={shown <= 0} onClick={() => tracker.show(shown - 1)} />
      <output class="counter" aria-label="Frame shown">{none ? "–" : shown}<small> / {none ? "–" : tracker.expected.value - 1}</small></output>
      <IconButton icon="next" name="One frame on" keys="→" disabled={shown >= newest} onClick={() => tracker.show(shown + 1)} />
      <IconButton icon="newest" name="The newest frame" keys="End" pressed={tracker.following.value && tracker.active.value} disabled={none} onClick={() => tracker.follow()} />
    </div>
  );
}

const TOOLS: [page.Tool, IconName, string, string][] = [
  ["point", "point", "Place points", "P"],
  ["brush", "brush", "Brush over an object", "B"],
  ["outline", "outline", "Outline an object, click by click", "O"],
];

function Tools() {
  const none = tracker.source.value === null;
  const tool = page.tool.value;
  const { count } = page.brush.value;
  const radius = page.brushRadius.value;
  return (
    <div class="transport tools" role="toolbar" aria-label="Tools">
      {TOOLS.map(([name, icon, says, keys]) => (
        <IconButton key={name} icon={icon} name={says} keys={keys} pressed={tool === name} onClick={() => (page.tool.value = name)} />
      ))}
      {tool === "brush" && (
        <label class="range" title="Radius of the brush ([ and ])"><span>Size</span>
          <input type="range" min={page.smallestBrush.value} max="200" value={radius} onInput={(event) => (page.brush.value = { radius: Number(event.currentTarget.value), count })} /></label>
      )}
      {tool !== "point" && (
        <label class="range" title="Points that the server places on the object, at most"><span>Points</span>
          <input type="number" min="3" max="256" value={count} onChange={(event) => (page.brush.value = { radius, count: Math.min(256, Math.max(3, Number(event.currentTarget.value) || 3)) })} /></label>
      )}
      <IconButton icon="grid" name="Add a grid of points" keys="G" disabled={none} onClick={page.addGrid} />
      <IconButton icon="color" name="Colour by confidence" keys="C" pressed={page.settings.value.confidence} onClick={() => page.change({ confidence: !page.settings.value.confidence })} />
      <IconButton icon="whole" name="Show the whole frame" keys="0" disabled={none} onClick={() => void ++page.zoomReset.value} />
    </div>
  );
}

function Legend() {
  if (!page.settings.value.confidence) return <Marks />;
  return <div class="scale"><span>0</span><i aria-hidden="true" /><span>1</span><span>confidence</span></div>;
}

export function App() {
  const dropping = useSignal(false);
  const none = tracker.source.value === null;
  const drop = (event: DragEvent) => {
    event.preventDefault();
    dropping.value = false;
    page.loadFiles([...(event.dataTransfer?.files ?? [])]);
  };
  const over = (event: DragEvent) => {
    event.preventDefault();
    dropping.value = true;
  };
  return (
    <>
      <Header />
      <main class={dropping.value ? "dropping" : ""} onDrop={drop} onDragOver={over} onDragLeave={() => (dropping.value = false)}>
        <section class="work" aria-label="Video">
          <div class="stage">
            {!none && <Stage />}
            {none && <Welcome />}
            <Hint />
            <div class="messages"><Banner /><Stale /><Notice /></div>
          </div>
          <div class="bar"><Transport /><Tools /><span class="spring" />{page.tool.value === "point" && <Legend />}</div>
          <Timeline />
        </section>
        <Panel />
      </main>
      <Help />
    </>
  );
}
