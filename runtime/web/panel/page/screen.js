// The participant's screen: what the server says, drawn at the screen's rate. All times are the server's, in ms.
import { Drawing } from "/drawing.js";
import { Link, stop as askStop } from "/link.js";

const OLD = 150; // ms of a value's age from which it isn't shown as if it followed
const SEND = 500; // ms between reports of frames
const FLASH = 1200; // ms that the word at the beginning is shown

const part = Object.fromEntries([...document.querySelectorAll("[id]")].map((e) => [e.id, e]));
const drawing = new Drawing(part.scene, part.live);

let participant = true;
let state = { phase: "idle", trial: null, began: 0, told: "" };
let newest = { t: 0, y: null, condition: "silent", words: "" };
let frames = [], finished = false, notice = "", stopWords = "";

// Connection

const link = new Link(hear, () => take({ phase: "idle", trial: null, began: 0, told: "" }));

function hear(message) {
  if (message.kind === "value") newest = message;
  else if (message.kind === "hello") participant = message.participant;
  else if (message.kind === "state") take(message);
  else if (message.kind === "notice") notice = message.words;
}

function take(given) {
  const began = given.phase === "running" && state.phase !== "running";
  if (JSON.stringify(given.trial) !== JSON.stringify(state.trial)) drawing.show(given.trial && given.trial.curve);
  if (began) [frames, finished, stopWords] = [[], false, ""];
  notice = "";
  state = given;
}

function report(final) {
  const rows = frames.splice(0);
  for (let i = 0; i < rows.length || i === 0; i += 200) { // a message has a longest length
    const last = final && i + 200 >= rows.length;
    link.say({ kind: "frames", rows: rows.slice(i, i + 200), final: last, round_trip: Math.min(link.best().trip, 1e6) });
  }
}

// Keys

function begin() {
  if (state.phase === "waiting" && participant) link.say({ kind: "begin" });
}

async function stop() {
  stopWords = "Stopping …";
  stopWords = await askStop(link);
}

addEventListener("keydown", (event) => {
  if (event.repeat) return;
  if (event.key === "Escape") stop();
  if (event.key === " ") { event.preventDefault(); begin(); }
});
addEventListener("keyup", (event) => { if (event.key === " ") event.preventDefault(); }); // presses no button
// In full screen the browser keeps Escape for itself: leaving full screen in a trial is a stop as well.
document.addEventListener("fullscreenchange", () => {
  if (!document.fullscreenElement && state.phase === "running") stop();
});
document.addEventListener("visibilitychange", () => { if (document.hidden) link.say({ kind: "hidden" }); });
part.stop.addEventListener("click", stop);
part.full.addEventListener("click", () => document.documentElement.requestFullscreen().catch(() => {}));
part.card.addEventListener("click", begin);

// Frames

function condition(now) {
  if (!link.socket) return ["lost", "The connection is lost"];
  if (newest.condition !== "live") return [newest.condition, newest.words];
  if (!(now - newest.t < OLD) || performance.now() - link.heard > OLD) return ["silent", "The pointer is late: no new data"];
  return ["live", ""];
}

function text(element, words) {
  if (element.textContent !== words) element.textContent = words;
  element.hidden = !words;
}

function words(now, kind, why) {
  const trial = state.trial;
  text(part.count, trial ? `Trial ${trial.number} of ${trial.of}` : "");
  text(part.title, trial ? trial.title : "");
  text(part.warning, stopWords || why);
  part.warning.className = kind === "held" && !stopWords ? "" : "grave";
  const t = (now - state.began) / 1e3;
  let clock = "", flash = "", card = null;
  if (state.phase === "running" && t < 0) {
    clock = `starts in ${Math.ceil(-t)} s`;
    flash = `${Math.min(Math.ceil(-t), Math.ceil(trial.settle))}`;
    part.note.textContent = "Bring the red pointer into the blue ring.";
  } else if (state.phase === "running") {
    clock = `${Math.max(Math.ceil(trial.duration - t), 0)} s`;
    flash = t * 1e3 < FLASH ? "Go" : "";
    part.note.textContent = "Keep the pointer on the blue line.";
  } else if (state.phase === "waiting") {
    const rest = Math.ceil((trial.rested - now) / 1e3);
    const told = state.told ? `${state.told}.` : notice;
    if (trial.rest > 0 && rest > 0) card = ["A short break", `Trial ${trial.number} of ${trial.of} can begin in ${rest} s.`, ""];
    else card = [`Trial ${trial.number} of ${trial.of}`, notice || told || "Follow the blue line with the red pointer.",
      participant ? "Press space to begin" : "The participant begins"];
    part.note.textContent = "The pointer shows your movement already.";
  } else {
    card = link.socket ? ["Please wait", state.told ? `${state.told}.` : "The next trial is being prepared.", ""] : null;
    part.note.textContent = "";
  }
  if (!participant) part.note.textContent = "This page only looks on: another one is the participant's.";
  text(part.clock, clock);
  text(part.flash, flash);
  part.card.hidden = !card;
  if (card) [part.headline, part.text, part.key].forEach((element, i) => text(element, card[i]));
}

function frame(at) {
  const now = link.time(at), drawn = link.time(performance.now()); // the frame's own stamp, and now indeed
  const [kind, why] = condition(drawn);
  const t = now - state.began;
  const running = state.phase === "running" && state.trial;
  const share = running ? Math.min(Math.max(t / 1e3 / state.trial.duration, 0), 1) : 0;
  const over = running && t > state.trial.duration * 1e3;
  const value = newest.y;
  drawing.frame(share, value, kind === "live", state.trial && share === 0, running && t >= 0 && !over);
  words(now, kind, why);
  const age = newest.t && Number.isFinite(drawn) ? drawn - newest.t : null;
  if (running && !over && Number.isFinite(now)) frames.push([now, value, age]);
  if (over && !finished) { finished = true; report(true); }
  globalThis.screenNow = { // for whoever looks from outside: what this frame shows
    phase: state.phase, participant, condition: kind, share, value, stamp: newest.t, age, at, now, connected: !!link.socket,
    x: drawing.x(share), y: value === null ? null : drawing.y(value), trace: drawing.trace.length,
  };
  requestAnimationFrame(frame);
}

setInterval(() => { if (state.phase === "running" && !finished) report(false); }, SEND);
requestAnimationFrame(frame);
