// What is beside the picture: how the run is and what to do, start and reset, devices, parameters, jog, recordings.
import { Pad } from "/pad.js";
import { Parameter } from "/parameter.js";
import { made, text } from "/part.js";

const SHOWN = 8000; // ms that an answer is shown
const MEANS = {
  start: "The limb begins to move. One that measures nothing begins at its home: put it there first. Is everybody clear?",
  reset: "This ends the stop, and the limb may move at once. It begins where it is measured; one that measures nothing goes slowly to its home. Is everybody clear?",
};
const ALLOWED = { ready: "start", stopped: "reset" };

export class Operator {
  constructor(part, say) {
    [this.part, this.say] = [part, say];
    this.yours = this.held = false;
    this.newest = null;
    this.pad = new Pad(part.jog, part.joints, say);
    this.fields = [];
    this.answered = [0, "", true]; // until when it is shown, words, whether it is well
    this.listed = -1; // the number of the newest event that is listed
    this.doubt = ""; // what waits for a second word
    this.about = ""; // what was shown of the stop when it was asked for
    this.shown = null; // the newest picture that was drawn
    part.control.addEventListener("click", () => this.say({ kind: "control", take: !this.yours }));
    for (const what of ["start", "reset"]) part[what].addEventListener("click", () => this.sure(what));
    part.yes.addEventListener("click", () => {
      if (this.doubt && this.shown) this.say({ kind: "ask", what: this.doubt, seen: this.shown.seen });
      this.sure("");
    });
    part.no.addEventListener("click", () => this.sure(""));
    part.list.addEventListener("click", () => {
      text(part.shelf_words, "They are read …");
      this.say({ kind: "recordings" });
    });
  }

  hear(message) {
    if (message.kind === "control") [this.yours, this.held] = [message.yours, message.held];
    else if (message.kind === "answer") this.answer(message);
    else if (message.kind === "recordings") this.shelf(message);
    else if (message.kind === "frame") {
      this.newest = message;
      this.pad.frame(message, this.yours && message.health.now === "active");
    }
  }

  lost() {
    this.pad.release();
    this.pad.allowed = this.yours = this.held = false;
    this.sure("");
  }

  show(scene) {
    this.pad.show(scene.joints);
    this.part.jog.hidden = !scene.joints.length;
    this.fields = scene.parameters.map((given) => new Parameter(given, (value) => this.say({ kind: "set", name: given.name, value })));
    this.part.fields.replaceChildren(...this.fields.map(({ row }) => row));
    this.part.parameters.hidden = !scene.parameters.length;
    this.sure("");
  }

  sure(what) {
    this.doubt = what;
    this.part.sure.hidden = !what;
    if (!what || !this.shown) return;
    this.about = about(this.shown);
    text(this.part.sure_words, MEANS[what]);
    text(this.part.yes, what === "start" ? "Start now" : "Reset now");
  }

  answer({ what, ok, words }) {
    this.answered = [performance.now() + SHOWN * (ok ? 0.5 : 2), words, ok];
    if (what === "set") for (const field of this.fields) field.until = 0;
  }

  shelf({ rows, more, words }) {
    this.part.shelf.replaceChildren(...rows.map((r) => {
      const line = made("li"), head = made("span", "head"), minutes = Math.floor(r.seconds / 60);
      const stop = r.fault ? `FAULT: ${r.stop}` : r.stop || "no stop";
      head.append(made("b", "", r.date || "no date"), made("span", r.fault ? "bad" : "quiet", stop));
      const length = `${minutes}:${(r.seconds - 60 * minutes).toFixed(1).padStart(4, "0")}`;
      line.append(head, made("span", "quiet", `${length} · ${size(r.bytes)}${r.simulated ? " · simulated" : r.partly.length ? ` · simulated: ${r.partly.join(", ")}` : ""} · ${r.name}`));
      if (r.problem) line.append(made("span", "bad", `${r.problem}. ${r.remedy}.`));
      return line;
    }));
    text(this.part.shelf_words, [words, more ? `${more} older ones: srl recordings` : ""].filter(Boolean).join(". "));
  }

  // Draws it all. current: whether rows come, so that what is shown is of now.
  draw(current, now) {
    const { part, newest } = this, linked = current && newest;
    part.desk.classList.toggle("old", !linked);
    text(part.control, this.yours ? "Give up control" : this.held ? "Take control from another tab" : "Take control");
    part.control.classList.toggle("yours", this.yours);
    const words = this.yours ? "This tab has control." : "Without control this tab can only stop.";
    text(part.control_words, linked ? words : "No data: what stands here is old.");
    part.control.disabled = !linked && !this.yours;
    text(part.answer, now < this.answered[0] ? this.answered[1] : "");
    part.answer.className = this.answered[2] ? "well" : "bad";
    if (!newest) return;
    const { health, devices } = newest, may = linked && this.yours;
    part.banner.classList.toggle("old", !linked);
    text(part.means, linked ? health.means : "How it is now isn't known.");
    text(part.why, linked ? health.why : `Last seen: ${health.means} ${health.why}`);
    text(part.stands, linked && health.stands ? `Still standing: ${health.stands}.` : "");
    text(part.todo, linked ? health.todo : "");
    for (const what of ["start", "reset"]) {
      part[what].disabled = !(may && ALLOWED[health.now] === what);
      part[what].hidden = (what === "start") !== (health.now === "ready" || health.now === "starting");
    }
    this.shown = newest;
    if (this.doubt && (!may || ALLOWED[health.now] !== this.doubt)) this.sure("");
    else if (this.doubt && about(newest) !== this.about) { // a person said yes to something else
      this.answered = [now + SHOWN, "What stopped it has changed. Read it, then ask again.", false];
      this.sure("");
    }
    this.list(devices);
    this.fields.forEach((field, i) => field.frame(newest.values[i] ?? null, may, now));
    text(part.jog_words, jogWords(newest, may));
    this.events(newest.events);
  }

  // What has happened, the newest first: when, what, and what to do about it.
  events(events) {
    const { events: section, events_lines: list } = this.part, last = events.length ? events.at(-1).number : -1;
    section.hidden = !events.length;
    if (last === this.listed) return;
    this.listed = last;
    list.replaceChildren(...[...events].reverse().map(({ at, words, level, remedy }) => {
      const line = made("li"), time = made("time", "", at);
      line.append(time, made("span", level === "error" ? "bad" : "", words));
      if (remedy) line.append(made("span", "remedy", remedy));
      return line;
    }));
  }

  list(devices) {
    const list = this.part.devices;
    while (list.children.length > devices.length) list.lastChild.remove();
    devices.forEach((device, i) => {
      let line = list.children[i];
      if (!line) {
        line = made("li");
        const head = made("span", "head");
        head.append(made("b"), made("span", "words"), made("span", "quiet"));
        line.append(head, made("span", "remedy"));
        list.append(line);
      }
      line.className = device.level;
      const [name, words, age] = line.firstChild.children;
      text(name, device.name);
      text(words, device.words);
      text(age, device.age === null || device.level === "bad" ? "" : `${device.age.toFixed(0)} ms`);
      text(line.lastChild, device.remedy && `${device.remedy}.`);
    });
  }
}

function about({ health }) { return [health.now, health.why, health.stands, health.todo].join("\n"); }

function jogWords(newest, may) {
  if (!newest.takes) return "This run is jogged on its terminal. To jog here, begin it with: srl jog PROFILE DEVICE --panel";
  if (!may) return "Take control to jog.";
  if (newest.health.now !== "active") return "A joint moves only while the run is active.";
  return "Hold ◀ or ▶. After a click here, while the blue line stands at the left, also the keys ← and →, slowly , and .; ↑ ↓ and 1 to 0 choose a joint. Any other key brakes. After a start or reset, wait a moment with no key held.";
}

function size(bytes) {
  return bytes < 1e6 ? `${(bytes / 1e3).toFixed(0)} kB` : bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}
