// SPDX-License-Identifier: Apache-2.0
import { keyName } from "./key_name";
import * as page from "./page";

interface Key {
  keys: string[]; // see keyName()
  shown?: string; // in the help; without it another key's line speaks of this one too
  does?: string;
  run: () => void;
}

const { tracker } = page;
const step = (frames: number) => () => tracker.show(tracker.shown.value + frames);

/** Every key of the page, in the order of the help. */
export const KEYS: Key[] = [
  { keys: [" "], shown: "Space", does: "start, pause, go on; after a run: play", run: () => tracker.toggle() },
  { keys: ["s"], shown: "S", does: "stop: no more frames, everything becomes final", run: () => tracker.stop() },
  { keys: ["r"], shown: "R", does: "track again from the first frame", run: () => tracker.start() },
  { keys: ["ArrowLeft"], shown: "← →", does: "one frame back, one frame on; with Shift ten", run: step(-1) },
  { keys: ["ArrowRight"], run: step(1) },
  { keys: ["Shift+ArrowLeft"], run: step(-10) },
  { keys: ["Shift+ArrowRight"], run: step(10) },
  { keys: ["Home"], shown: "Home End", does: "the first frame, the newest and those to come", run: () => tracker.show(0) },
  { keys: ["End"], run: () => tracker.follow() },
  { keys: ["p"], shown: "P", does: "place points one by one", run: () => (page.tool.value = "point") },
  { keys: ["b"], shown: "B", does: "brush over an object", run: () => (page.tool.value = "brush") },
  { keys: ["o"], shown: "O", does: "outline an object, click by click", run: () => (page.tool.value = "outline") },
  { keys: ["Enter"], shown: "Enter", does: "close the outline that is being drawn", run: page.closeOutline },
  { keys: ["["], shown: "[ ]", does: "a smaller brush, a larger one", run: () => page.resizeBrush(1 / 1.25) },
  { keys: ["]"], run: () => page.resizeBrush(1.25) },
  { keys: ["g"], shown: "G", does: "add a grid of points", run: page.addGrid },
  { keys: ["n"], shown: "N", does: "select the next point or object; with Shift the one before", run: () => page.selectNext(1) },
  { keys: ["Shift+n"], run: () => page.selectNext(-1) },
  { keys: ["Delete", "Backspace"], shown: "Del", does: "remove the selected point or object; of an outline, the last corner", run: page.removeLast },
  { keys: ["Escape"], shown: "Esc", does: "give up an outline; select nothing", run: page.escape },
  { keys: ["c"], shown: "C", does: "colour by confidence, or by point", run: () => page.change({ confidence: !page.settings.value.confidence }) },
  { keys: ["0"], shown: "0", does: "show the whole frame", run: () => void ++page.zoomReset.value },
  { keys: ["d"], shown: "D", does: "dark or light", run: page.changeTheme },
  { keys: ["?", "h"], shown: "?", does: "this help", run: () => (page.helpOpen.value = !page.helpOpen.value) },
];

const TYPING = "input, select, textarea, [contenteditable]";

/** Lets keys do what they stand for, except where the user types or a control has its own use of them. */
export function listenToKeys(): void {
  addEventListener("keydown", (event) => {
    const target = event.target as HTMLElement;
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || target.closest(TYPING)) return;
    if (page.helpOpen.value && event.key !== "?") {
      if (event.key === "Escape") page.helpOpen.value = false; // the dialog says so too, a moment later
      return;
    }
    if ((event.key === " " || event.key === "Enter") && target.closest("button, summary, a")) return;
    const name = keyName(event);
    const key = KEYS.find(({ keys }) => keys.includes(name));
    if (!key) return;
    event.preventDefault();
    key.run();
  });
  // A button that was clicked with a pointer lets the keys be: Space starts, and does not click it again.
  addEventListener("click", (event) => {
    if (event.detail > 0) (event.target as HTMLElement).closest<HTMLElement>("button, summary")?.blur();
  });
}
