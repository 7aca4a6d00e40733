// A parameter: what the loop has of it, and what is asked for. What stands there is what is sent, to the last figure.
import { made, measure, text } from "/part.js";

const WAIT = 3000; // ms that an answer may take, before the slider goes back to what the loop has
const STEPS = 50; // at least, from one bound to the other

export class Slider {
  // given: name, lower, upper, unit, text, default; change(value): asks the loop for it.
  constructor(given, change) {
    [this.given, this.change] = [given, change];
    const bounded = this.bounded = given.lower !== null && given.upper !== null;
    this.exponent = bounded ? Math.floor(Math.log10((given.upper - given.lower) / STEPS)) : 0;
    this.until = 0; // until when an answer is waited for, on the page's own clock
    this.active = false; // whether it is being changed
    this.row = made("label", "slider");
    [this.input, this.value, this.asked] = [made("input"), made("output"), made("span", "asked")];
    this.input.type = bounded ? "range" : "number";
    this.input.step = "any";
    if (bounded) [this.input.min, this.input.max] = [given.lower, given.upper];
    this.input.addEventListener("input", () => { this.active = true; });
    this.input.addEventListener("change", () => this.changed());
    this.input.addEventListener("blur", () => { this.active = false; });
    const head = made("span", "head"), ends = made("span", "quiet ends");
    head.append(made("b", "", given.name), this.asked, this.value);
    if (bounded) ends.append(...[given.lower, given.upper].map((end) => made("span", "", measure(end, given.unit, 9))));
    this.row.append(head, this.input, ends, made("span", "quiet", `${given.text} · ${this.words(given.default)} at first`));
  }

  // The number that is asked for, as the loop would get it; null where none stands there: an empty field isn't 0.
  wanted() {
    const raw = this.input.value.trim() === "" ? NaN : Number(this.input.value);
    if (!Number.isFinite(raw)) return null;
    if (!this.bounded) return raw;
    const { lower, upper } = this.given, step = 10 ** this.exponent;
    const round = Number((Math.round(raw / step) * step).toPrecision(12));
    return Number.isFinite(round) ? Math.min(Math.max(round, lower), upper) : null;
  }

  changed() {
    this.active = false;
    const wanted = this.wanted();
    if (wanted === null) return;
    this.input.value = wanted;
    this.until = performance.now() + WAIT;
    this.change(wanted);
  }

  words(value) {
    if (!this.bounded && value !== null) return measure(Number(value.toPrecision(9)), this.given.unit, 20);
    return measure(value, this.given.unit, Math.min(Math.max(3, -this.exponent), 20) || 3);
  }

  // has: what the loop has; may: whether it can be changed here.
  frame(has, may, now) {
    text(this.value, this.words(has));
    this.input.disabled = !may;
    const waits = this.active || now < this.until, wanted = waits ? this.wanted() : null;
    text(this.asked, wanted !== null && wanted !== has ? `asked ${this.words(wanted)}` : "");
    if (!waits && has !== null && Number(this.input.value || NaN) !== has) this.input.value = has;
  }
}
