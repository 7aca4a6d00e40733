// A parameter: what the loop has of it, and what is asked for. It is typed, or changed by steps; a large jump is asked
// about once more. What stands there is what is sent, to the last figure.
import { button, made, measure, text } from "/part.js";

const WAIT = 3000; // ms that an answer may take, before the field goes back to what the loop has
const STEPS = 50; // about, from one bound to the other
const JUMP = 0.25; // of the way between the bounds; a larger change is asked about
const FACTOR = 2; // the same of one without bounds
const NUMBER = /^[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d{1,3})?$/i, GROUPS = /^[-+]?\d{1,3}(,\d{3})+$/;

export class Parameter {
  // given: name, lower, upper, unit, text, default; change(value): asks the loop for it.
  constructor(given, change) {
    [this.given, this.change] = [given, change];
    const { name, lower, upper } = given;
    this.bounded = lower !== null && upper !== null;
    this.step = this.bounded ? nice((upper - lower) / STEPS) : 0;
    this.until = 0; // until when an answer is waited for, on the page's own clock
    this.sent = null; // what was asked for last
    this.doubt = null; // what would be a large jump
    this.has = null;
    this.row = made("div", "parameter");
    const head = made("div", "head"), keys = made("div", "row"), id = `parameter_${name}`;
    [this.value, this.asked, this.input, this.bar, this.sure] = [made("output"), made("span", "asked"), made("input"), made("i", "between"), made("div", "sure")];
    const label = made("label", "", name);
    Object.assign(this.input, { type: "text", inputMode: "decimal", autocomplete: "off", id });
    label.htmlFor = id;
    this.asked.setAttribute("role", "status");
    this.down = button("−", () => this.by(-1));
    this.up = button("+", () => this.by(1));
    this.set = button("Set", () => this.typed());
    this.down.setAttribute("aria-label", `${name} one step down`);
    this.up.setAttribute("aria-label", `${name} one step up`);
    this.set.setAttribute("aria-label", `Set ${name}`);
    this.input.addEventListener("keydown", (event) => this.pressed(event));
    this.row.addEventListener("focusout", (event) => { if (!this.row.contains(event.relatedTarget)) this.forget(); });
    const ends = this.bounded ? `${measure(lower, "", 9)} to ${measure(upper, given.unit, 9)}` : "";
    const about = made("span", "quiet", [ends, given.text, `${this.words(given.default)} at first`].filter(Boolean).join(" · "));
    about.id = `${id}_about`;
    this.input.setAttribute("aria-describedby", about.id);
    this.yes = button("Change it", () => {
      const wanted = this.doubt;
      this.doubt = null;
      this.ask(wanted);
      this.input.focus();
    });
    this.yes.addEventListener("keydown", (event) => { if (event.repeat) event.preventDefault(); }); // the Enter that asked, held
    this.set.addEventListener("pointerdown", (event) => event.preventDefault()); // the field keeps the focus, and what stands there
    this.question = made("p");
    const answers = made("div", "row");
    answers.append(this.yes, button("No", () => this.forget()));
    this.sure.append(this.question, answers);
    this.sure.setAttribute("role", "alert");
    head.append(label, this.asked, this.value);
    keys.append(...(this.bounded ? [this.down, this.input, this.up, this.set] : [this.input, this.set]));
    this.row.append(head, keys, ...(this.bounded ? [this.bar] : []), about, this.sure);
    this.bar.append(made("b"));
    this.own = ""; // what the loop's value is as it stands in the field
  }

  pressed(event) {
    const steps = { ArrowUp: 1, ArrowDown: -1, PageUp: 5, PageDown: -5 }[event.key];
    if (event.key === "Enter") { if (!event.repeat) this.typed(); }
    else if (steps && this.bounded) this.by(steps);
    else return;
    event.preventDefault();
  }

  // The number that stands in the field; null where none does: an empty field isn't 0, and 1,000 may be 1 or 1000.
  wanted() {
    const raw = this.input.value.trim();
    return NUMBER.test(raw) && !GROUPS.test(raw) ? Number(raw.replace(",", ".")) : null;
  }

  by(steps) {
    const from = performance.now() < this.until ? this.sent : this.has;
    if (from === null) return;
    this.weigh(Number((from + steps * this.step).toPrecision(12)), true);
  }

  typed() {
    const wanted = this.wanted();
    if (wanted !== null) this.weigh(wanted, false);
  }

  // step: whether it came of a step, which ends at a bound; what is typed isn't changed, and is refused beyond it.
  weigh(wanted, step) {
    const { lower, upper, unit } = this.given, has = this.has;
    if (this.bounded && step) wanted = Math.min(Math.max(wanted, lower), upper);
    const less = Math.min(Math.abs(wanted), Math.abs(has)), more = Math.max(Math.abs(wanted), Math.abs(has));
    const far = has === null || (this.bounded ? Math.abs(wanted - has) > JUMP * (upper - lower) : wanted * has < 0 || more > FACTOR * less);
    const out = this.bounded && !(wanted >= lower && wanted <= upper);
    if (far && !step && !out) {
      this.doubt = wanted;
      text(this.question, `${this.words(has)} → ${measure(wanted, unit, 12)} is a large jump, and the limb may be moving.`);
      this.sure.hidden = false;
      this.yes.focus();
    } else this.ask(wanted); // the server says what is out of bounds
  }

  ask(wanted) {
    this.input.value = this.own = String(wanted);
    this.sent = wanted;
    this.until = performance.now() + WAIT;
    this.change(wanted);
  }

  // What was typed and not sent goes.
  forget() {
    this.doubt = null;
    if (performance.now() >= this.until && this.has !== null) this.input.value = this.own = String(this.has);
  }

  words(value) { return measure(value === null ? null : Number(value.toPrecision(9)), this.given.unit, 12); }

  // has: what the loop has; may: whether it can be changed here.
  frame(has, may, now) {
    const waits = now < this.until, before = this.has;
    this.has = has;
    if (!may) this.doubt = null;
    text(this.value, this.words(has));
    for (const key of [this.input, this.down, this.up, this.set]) key.disabled = !may;
    const edits = this.row.contains(document.activeElement) && this.input.value !== this.own;
    this.sure.hidden = this.doubt === null;
    text(this.asked, waits && this.sent !== has ? `asked ${this.words(this.sent)}` : edits ? (this.wanted() === null ? "no number" : "not set yet") : "");
    if (!waits && !edits && has !== null) this.input.value = this.own = String(Number(has.toPrecision(12)));
    if (this.bounded && has !== before && has !== null) this.bar.firstChild.style.width = `${100 * (has - this.given.lower) / (this.given.upper - this.given.lower)}%`;
  }
}

function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return Number((power * [1, 2, 5, 10].find((k) => k * power >= step * 0.999)).toPrecision(3));
}
