// SPDX-License-Identifier: Apache-2.0
import { useEffect, useRef } from "preact/hooks";
import { KEYS } from "../keys";
import * as page from "../page";
import { IconButton } from "./icons";

const GESTURES = [
  ["Click", "place a point"],
  ["Drag a point", "say where it is: it is followed from there on"],
  ["Shift and drag", "brush over an object, whatever the tool: it is followed as a group"],
  ["Right click", "remove a point, or an object by its centre; of an outline, the last corner"],
  ["Wheel", "zoom; the middle button moves the picture"],
  ["Timeline", "click or drag to look at earlier frames"],
] as const;

/** A point that has left its object. */
export function LeftMark() {
  return <svg class="left-mark" viewBox="0 0 14 14" aria-hidden="true"><path d="M3 3l8 8M11 3l-8 8" /></svg>;
}

export function Marks({ objects }: { objects?: boolean }) {
  return (
    <ul class="marks">
      <li><svg viewBox="0 0 34 14" aria-hidden="true"><path d="M2 7h20" /><circle class="full" cx="26" cy="7" r="4.5" /></svg>final</li>
      <li><svg viewBox="0 0 34 14" aria-hidden="true"><path class="dashed" d="M2 7h18" /><circle class="full" cx="26" cy="7" r="2.7" /><circle class="dashed" cx="26" cy="7" r="4.5" /></svg>provisional</li>
      <li><svg viewBox="0 0 34 14" aria-hidden="true"><path d="M2 7h18" /><circle cx="26" cy="7" r="4.5" /></svg>hidden</li>
      {objects && <li><LeftMark />left its object</li>}
    </ul>
  );
}

export function Help() {
  const dialog = useRef<HTMLDialogElement>(null);
  const open = page.helpOpen.value;
  useEffect(() => {
    if (open && !dialog.current!.open) dialog.current!.showModal();
    if (!open) dialog.current!.close();
  }, [open]);
  const close = () => (page.helpOpen.value = false);
  return (
    <dialog ref={dialog} class="help" aria-labelledby="help-title" onClose={close} onClick={(event) => event.target === dialog.current && close()}>
      <div class="help-body">
        <header>
          <h2 id="help-title" tabIndex={-1} autofocus>How it works</h2>
          <IconButton icon="close" name="Close the help" keys="Esc" onClick={close} />
        </header>
        <p>Place points on what you want to follow, or brush over an object or outline it, and start. Each frame goes to the server; where the points are comes back, provisional at first, final a moment later.</p>
        <p>An object has points that the server places, an outline, and at its centre a gauge of how much of it is in sight. Points that do not move with it any more are crossed out.</p>
        <Marks objects />
        <div class="help-columns">
          <section>
            <h3>Pointer</h3>
            <dl>{GESTURES.map(([gesture, does]) => [<dt key={gesture}>{gesture}</dt>, <dd key={does}>{does}</dd>])}</dl>
            <h3>Without a pointer</h3>
            <p>Tab to the picture: arrow keys move a crosshair (Shift: by one pixel), Enter places or selects a point there, with the brush an object, or a corner of an outline, which Enter at the same place again closes.</p>
          </section>
          <section>
            <h3>Keys</h3>
            <dl>
              {KEYS.filter(({ shown }) => shown).map(({ shown, does }) => [
                <dt key={shown}>{shown!.split(" ").map((key) => <kbd key={key}>{key}</kbd>)}</dt>,
                <dd key={does}>{does}</dd>,
              ])}
            </dl>
          </section>
        </div>
        <p class="soft"><a href="licenses.txt">What this page is made of</a></p>
      </div>
    </dialog>
  );
}
