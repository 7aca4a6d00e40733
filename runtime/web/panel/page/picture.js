// The live picture: what the server says, drawn at the screen's rate.
import { Curves } from "/curves.js";
import { Guide } from "/guide.js";
import { Link, stop as askStop } from "/link.js";
import { Eye } from "/eye.js";
import { Legend } from "/legend.js";
import { Operator } from "/operator.js";
import { text } from "/part.js";
import { Space } from "/space.js";

const OLD = 250; // ms of a row's age from which it isn't shown as if it were now

const part = Object.fromEntries([...document.querySelectorAll("[id]")].map((e) => [e.id, e]));
const eye = new Eye(part.space), curves = new Curves(part.curves, part.pause), legend = new Legend(part, eye);
let space = null; // what draws, once it is known what there is to draw with
let scene = null, newest = null, stopWords = "", asked = -1, frames = 0; // asked: the newest row when a stop was answered
let drawn = {}; // of which row, seen from where

const operator = new Operator(part, (message) => link.say(message));
const guide = new Guide(part, (message) => link.say(message));
const link = new Link(hear, () => operator.lost());

function hear(message) {
  operator.hear(message);
  guide.hear(message);
  operator.pad.guide(guide.joint());
  if (message.kind === "scene") show(message);
  else if (message.kind === "frame") {
    newest = message;
    curves.take(message.t, message.curves);
  }
}

function show(given) {
  [scene, newest, stopWords, asked] = [given, null, "", -1];
  document.title = part.name.textContent = given.name;
  curves.show(given.plots, given.palette);
  operator.show(given);
  legend.show(given);
  draws(given);
}

// Lit bodies if three.js is there and the browser can; else a flat picture, which says so.
async function draws(given) {
  if (space) return;
  let why = given.solid ? "" : "A flat picture: three.js isn't installed. `python -m srl.runtime.web.panel.three` gets it.";
  if (!why) {
    try {
      const { Solid } = await import("/solid.js");
      space = new Solid(part.space, part.tags, eye);
      part.space.addEventListener("webglcontextlost", () => text(part.flat, "The browser has lost its graphics. Load the page again."));
    } catch (error) { why = `A flat picture: this browser has no WebGL 2 (${error.message}).`; }
  }
  if (why) space = new Space(part.space, eye);
  text(part.flat, why);
  part.axes.disabled = !space.axes || !given.frames.length;
}

async function stop() {
  stopWords = "Stopping …";
  stopWords = await askStop(link);
  asked = newest ? newest.cycle : -1;
}

addEventListener("keydown", (event) => { if (event.key === "Escape" && !event.repeat) stop(); }, true);
part.stop.addEventListener("click", stop);
part.front.addEventListener("click", () => eye.look(0, 0.1));
part.side.addEventListener("click", () => eye.look(-Math.PI / 2, 0.1));
part.above.addEventListener("click", () => eye.look(0, 1.5));
part.axes.addEventListener("change", () => { eye.frames = part.axes.checked; });
part.follow.addEventListener("change", () => { eye.follow = part.follow.checked; });

// What is wrong with the picture as it is: its kind, and the words for it.
function condition(now) {
  if (!link.socket) return ["lost", "The connection is lost"];
  if (!newest) return ["silent", "The system gives no data"];
  if (newest.condition === "silent" || newest.condition === "ended") return [newest.condition, newest.words];
  if (!(now - newest.t < OLD) || performance.now() - link.heard > OLD) return ["silent", "The picture is late: no new data"];
  return [newest.condition, newest.words];
}

function frame() {
  const now = link.time(performance.now());
  const [kind, words] = condition(now);
  const current = kind === "live" || kind === "held" || kind === "stopped"; // rows come: the picture is of now
  const laws = newest && newest.state === "active"; // otherwise no law runs, and what they gave stays
  const isNow = (thing) => current && (laws || !thing.law);
  const asItWas = scene && current && !laws && scene.things.some((thing) => thing.law) ? ". Grey: as it was then" : "";
  if (scene && newest) {
    if (space?.hurry?.(performance.now())) drawn = {};
    const view = [kind, laws, ...eye.view(), matchMedia("(prefers-color-scheme: light)").matches].join();
    if (space && (newest !== drawn.row || view !== drawn.view)) {
      drawn = { row: newest, view };
      space.draw(scene, newest, isNow);
    }
    curves.draw(current ? Math.max(now, newest.t) : newest.t);
    text(part.state, newest.state);
    part.state.className = current ? newest.state : ""; // a state that may be over has no colour
    const simulated = scene.simulated.length ? "simulated · " : "";
    text(part.facts, `${simulated}${Number(scene.rate.toFixed(1))} Hz · cycle ${newest.cycle}`);
  }
  if (current && newest.cycle > asked && newest.state === "stopped") stopWords = ""; // it has come to pass
  text(part.warning, [stopWords, words && words + asItWas].filter(Boolean).join(". "));
  part.warning.className = kind === "held" && !stopWords ? "mild" : "";
  operator.draw(current, performance.now());
  guide.draw(Boolean(link.socket), operator.yours, !scene || !scene.things.length, kind === "stopped");
  frames++;
  globalThis.pictureNow = { // for whoever looks from outside: what this frame shows
    condition: kind, words, cycle: newest && newest.cycle, current, frames, drawn: space && space.drawn, solid: Boolean(space && space.renderer), ratio: space && space.renderer && space.renderer.getPixelRatio(), age: newest && now - newest.t,
    control: operator.yours, jogging: operator.pad.way, takes: newest && newest.takes, turn: eye.turn, distance: eye.distance, plots: curves.plots.map((p) => [p.title, p.labels, p.samples.length]),
    things: scene && newest && scene.things.map((thing, i) => [thing.name, newest.things[i], isNow(thing)]),
  };
  requestAnimationFrame(frame);
}

requestAnimationFrame(frame);
