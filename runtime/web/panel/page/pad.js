// Joints that move while a key or a button is held. The page answers each picture of the server with a press, and the
// press counts from when that picture was made: whatever stalls or dies on the way, no press follows, and the loop's
// law brakes by itself. So letting go needs no message; one is sent all the same, to brake at once. The keys count only
// while the focus is in the jog's area: elsewhere an arrow scrolls, or changes a parameter.
import { button, made, measure, text } from "/part.js";

const WAYS = { ArrowLeft: [-1], ArrowRight: [1], ",": [-1, true], ".": [1, true] }; // and whether it is a fine motion
const GAP = 150; // ms without a picture after which a held key must be pressed anew

export class Pad {
  // area: what must have the focus; box: in it, where the joints are listed.
  constructor(area, box, say) {
    [this.area, this.box, this.say] = [area, box, say];
    this.joints = [];
    this.rows = [];
    this.joint = 0;
    this.way = 0; // the sense in which the held key or button moves; 0: none is held
    this.fine = false; // whether it moves slowly
    this.only = null; // the joint that a guided calibration moves now; -1: none; null: there is no such calibration
    this.key = this.code = ""; // the key that is held, as it means and as it lies; "": a button is held
    this.told = this.came = 0; // the newest picture's own time; when it came
    this.allowed = false;
    area.addEventListener("keydown", (event) => this.pressed(event));
    addEventListener("keydown", (event) => { if (!area.contains(event.target)) this.release(); }); // of a held mouse
    area.addEventListener("focusout", (event) => { if (!area.contains(event.relatedTarget)) this.release(); });
    // Shift or Num Lock can change what a key means while it is held. One without a place may be any.
    addEventListener("keyup", (event) => {
      if (!event.code || event.code === this.code || event.key === this.key) this.release();
    });
    for (const name of ["blur", "pagehide"]) addEventListener(name, () => this.release());
    // A pointer is up once all its buttons are; the mouse tells of each. A lost end shows when it moves again.
    addEventListener("pointermove", (event) => { if (this.way && !this.key && !(event.buttons & 1)) this.release(); });
    for (const name of ["pointerup", "pointercancel", "mouseup"]) addEventListener(name, () => this.release());
    document.addEventListener("visibilitychange", () => this.release());
    addEventListener("contextmenu", () => this.release());
  }

  show(joints) {
    this.release();
    [this.joints, this.joint] = [joints, this.only > 0 ? this.only : 0];
    this.rows = joints.map((joint, i) => {
      const row = made("div", "joint"), name = button(joint.name, () => this.choose(i));
      const place = made("output"), range = made("span", "quiet");
      const bounds = joint.lower === null || joint.upper === null ? "" : `${measure(joint.lower, "")} to ${measure(joint.upper, joint.unit)}`;
      range.textContent = [joint.measured ? "measured" : "as commanded, not measured", bounds].filter(Boolean).join(" · ");
      const ways = [-1, 1].map((way) => {
        const held = button(way < 0 ? "◀" : "▶");
        held.setAttribute("aria-label", `${joint.name} to ${way < 0 ? "lower" : "higher"} values`);
        held.addEventListener("pointerdown", (event) => {
          if (event.button) return;
          this.choose(i);
          if (this.joint === i) this.hold(way, false, "", "");
        });
        held.addEventListener("pointerleave", () => this.release());
        return held;
      });
      row.append(name, ways[0], ways[1], place, range);
      return { row, name, place, ways };
    });
    this.box.replaceChildren(...this.rows.map(({ row }) => row));
    this.mark();
  }

  // A guided calibration says which joint moves; what was held was meant for the one before.
  guide(only) {
    if (only === this.only) return;
    this.release();
    this.only = only;
    if (only >= 0) this.choose(only);
    this.mark();
  }

  choose(i) {
    if (this.only !== null && i !== this.only) return;
    if (i === this.joint || !(i >= 0 && i < this.joints.length)) return;
    this.release();
    this.joint = i;
    this.mark();
  }

  mark() { this.rows.forEach(({ row }, i) => row.classList.toggle("chosen", i === this.joint)); }

  pressed(event) {
    if (event.repeat && this.key && event.key !== this.key) this.release();
    if (!this.allowed || event.repeat) return;
    if (event.altKey || event.ctrlKey || event.metaKey) { this.release(); return; }
    const [way, fine] = WAYS[event.key] || [], step = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (way) this.hold(way, Boolean(fine), event.key, event.code);
    else this.release(); // any other key brakes
    if (step) this.choose((this.joint + step + this.joints.length) % this.joints.length);
    if (/^[0-9]$/.test(event.key)) this.choose((Number(event.key) + 9) % 10);
    if (way || step) event.preventDefault();
  }

  hold(way, fine, key, code) {
    if (!this.allowed || this.only === -1) return;
    [this.way, this.fine, this.key, this.code] = [way, fine, key, code];
  }

  focused() { return this.area.contains(document.activeElement); }

  release() {
    if (this.way) this.say({ kind: "jog", joint: this.joint, way: 0, heard: this.told });
    [this.way, this.key, this.code] = [0, "", ""];
  }

  // A picture has come; allowed: whether this page may move a joint now.
  frame(message, allowed) {
    const now = performance.now(), gap = now - this.came > GAP;
    [this.told, this.came] = [message.told, now];
    if (gap) this.release();
    this.allowed = allowed && this.joints.length > 0 && message.takes;
    if (!this.allowed || document.hidden || !document.hasFocus() || (this.key && !this.focused())) this.release();
    if (this.way) this.say({ kind: "jog", joint: this.joint, way: this.way, fine: this.fine, heard: message.told });
    this.rows.forEach(({ place, ways }, i) => {
      const at = message.places[i] ?? null;
      text(place, at === null ? "-" : `${at.toFixed(3)} ${this.joints[i].unit === "1" ? "" : this.joints[i].unit}`.trim());
      for (const way of ways) way.disabled = !this.allowed || (this.only !== null && i !== this.only);
    });
  }
}
