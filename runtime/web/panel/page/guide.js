// A guided calibration: what to do now, how far it is, and the buttons that stand for the terminal's keys.
import { button, made, text } from "/part.js";

const SIGNS = { done: "✓", weak: "!", now: "▶", "left out": "–" };

export class Guide {
  constructor(part, say) {
    [this.part, this.say] = [part, say];
    this.now = this.report = this.over = null;
    this.chosen = 0; // the number that would be done again; 0: none
    this.doubt = -1; // the step in which it was asked whether to break off
    this.drawn = ""; // of the report's picture
    const typed = { guide_on: () => "", guide_skip: () => "s", guide_redo: () => `r ${this.chosen}` };
    for (const [name, words] of Object.entries(typed)) {
      part[name].addEventListener("click", () => this.type(words()));
    }
    part.guide_end.addEventListener("click", () => { this.doubt = this.now ? this.now.step : -1; });
    part.guide_no.addEventListener("click", () => { this.doubt = -1; });
    part.guide_yes.addEventListener("click", () => { if (this.sure()) this.type("q"); });
  }

  // Whatever is pressed counts for the step that stands on the page.
  type(typed) {
    if (this.now) this.say({ kind: "guide", typed, step: this.now.step });
    this.chosen = 0;
    this.doubt = -1;
  }

  sure() { return Boolean(this.now) && this.doubt === this.now.step; }

  hear(message) {
    if (message.kind === "guide") {
      this.now = message;
      this.over = null;
      if (!message.asks) this.report = null;
    } else if (message.kind === "guide_report") this.report = message;
    else if (message.kind === "guide_over") this.over = message;
    else if (message.kind === "guide_gone") this.now = this.report = this.over = null;
  }

  // The joint that is moved now under a held key; -1: none; null: nothing ever moves.
  joint() { return this.now && !this.over ? this.now.joint ?? null : null; }

  // may: whether this page has control; bare: whether there is nothing to see in space; stands: whether the run
  // is stopped.
  draw(linked, may, bare, stands) {
    const { part, now, report, over } = this;
    document.body.classList.toggle("bare", bare);
    document.body.classList.toggle("guided", Boolean(now));
    part.guide.hidden = !now;
    if (!now) return;
    const runs = linked && !over, asks = now.asks, refused = Boolean(report && report.refused.length);
    part.guide.classList.toggle("old", !runs && !over);
    text(part.guide_title, now.title);
    text(part.guide_task, over ? (over.ok ? "The calibration is done" : "The calibration has ended") : now.task);
    text(part.guide_over, over ? over.words : "");
    part.guide_over.className = over && over.ok ? "well" : "bad";
    const missing = stands ? "The run is stopped: nothing counts until it is reset" : now.missing;
    text(part.guide_missing, over || !missing ? "" : `${missing}.`);
    text(part.guide_lack, over || !now.lack ? "" : `${now.lack}.`);
    this.bars(over ? [] : now.bars);
    this.states(now, may && runs);
    part.guide_keys.hidden = Boolean(over);
    text(part.guide_on, asks ? "Write the file" : "Go on now");
    part.guide_on.hidden = asks && refused;
    part.guide_skip.hidden = asks;
    text(part.guide_redo, this.chosen ? `Do ${this.chosen} again` : "Do again …");
    text(part.guide_end, asks ? "End without a file" : "Break off");
    for (const name of ["guide_on", "guide_skip", "guide_end"]) part[name].disabled = !(may && runs);
    part.guide_redo.disabled = !(may && runs && this.chosen);
    part.guide_sure.hidden = !(this.sure() && may && runs);
    const moved = "Hold ◀ or ▶ of the joint, under Jog. Go on once it is where it should be. ";
    const itself = asks ? "" : this.joint() === null ? "Each step goes on by itself once it is done. " : moved;
    const again = `To do one of the ${now.things} again, choose its number${refused ? ' ("r N" below is that)' : ""}.`;
    text(part.guide_words, !runs ? "" : may ? itself + again : "Take control to press these.");
    this.choices(asks && !over && report ? report.choices : [], may && runs);
    this.tell(report);
    if (part.guide_said.textContent !== now.said.join("")) part.guide_said.replaceChildren(...now.said.map((line) => made("li", "", line)));
  }

  bars(bars) {
    const box = this.part.guide_bars;
    while (box.children.length > bars.length) box.lastChild.remove();
    bars.forEach((bar, i) => {
      let row = box.children[i];
      if (!row) {
        row = made("div", "bar");
        const track = made("i");
        track.append(made("b"));
        row.append(made("span"), track, made("output"));
        box.append(row);
      }
      const [name, track, said] = row.children;
      text(name, bar.name);
      text(said, bar.said.trim());
      track.hidden = bar.share === null;
      row.classList.toggle("plain", bar.share === null);
      track.className = bar.good === null ? "" : bar.good ? "good" : "poor";
      if (bar.share !== null) track.firstChild.style.width = `${100 * bar.share}%`;
    });
  }

  states({ states, things, step }, able) {
    const { part } = this;
    text(part.guide_things, states.length ? things : "");
    while (part.guide_states.children.length > states.length) part.guide_states.lastChild.remove();
    if (this.chosen > states.length) this.chosen = 0;
    states.forEach((state, i) => {
      let chip = part.guide_states.children[i];
      if (!chip) {
        chip = button("", () => { this.chosen = this.chosen === i + 1 ? 0 : i + 1; });
        part.guide_states.append(chip);
      }
      const kind = state.split(":")[0];
      text(chip, `${i + 1} ${SIGNS[kind] || "·"}`);
      chip.title = state;
      chip.setAttribute("aria-label", `number ${i + 1}: ${state}`);
      chip.setAttribute("aria-pressed", String(this.chosen === i + 1));
      chip.className = `chip ${kind.replace(" ", "_")}`;
      chip.disabled = !able;
    });
    const weak = states.map((state, i) => [i + 1, state]).filter(([, state]) => state.startsWith("weak")).map(([i, state]) => `${i}: ${state}`);
    text(part.guide_weak, weak.join("\n"));
  }

  choices(choices, able) {
    const box = this.part.guide_choices, key = JSON.stringify(choices);
    if (box.dataset.of !== key) {
      box.dataset.of = key;
      box.replaceChildren(...choices.map(([typed, words]) => button(words, () => this.type(typed))));
    }
    for (const each of box.children) each.disabled = !able;
  }

  tell(report) {
    const { part } = this;
    part.guide_report.hidden = !report;
    if (!report) return;
    const refused = report.refused.map((reason) => `Refused: ${reason}`).join("\n");
    text(part.guide_refused, refused);
    text(part.guide_lines, report.lines.join("\n"));
    part.guide_picture.hidden = !report.picture;
    if (report.picture && report.picture !== this.drawn) part.guide_picture.src = `data:image/png;base64,${report.picture}`;
    this.drawn = report.picture;
  }
}
