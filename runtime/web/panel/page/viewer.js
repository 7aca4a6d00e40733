// rerun's viewer, made by the plain script /re_viewer.js, with the run's data from this page's own connection.
//
// The picture never looks as if it were of now when it isn't: a red frame with words comes up. It comes up by itself,
// drawn by the browser's compositor, unless this script puts it off each time that a newer picture is on the screen:
// so it does, too, while the viewer keeps the script from running.

import { Age } from "/age.js";
import { Link, stop as askStop } from "/link.js";
import { text } from "/part.js";

const CHANNEL = "run", LATE = 1000; // ms of a picture's age from which it isn't shown as if it were of now
const NOT = -1; // in place of a picture's time: not of now
const CHECK = 50; // ms between looks, where the browser draws no frames
const part = Object.fromEntries([...document.querySelectorAll("[id]")].map((e) => [e.id, e]));
let handle = null, age = null, link = null, run = null, now = null, began = performance.now(), newest = 0, stopWords = "", failure = "";
let alarms = [], armed = null; // the animations that bring up the red frame, and the picture's time they are for

async function stop() {
  stopWords = "Stopping …";
  stopWords = await askStop(link);
}

addEventListener("keydown", (event) => { if (event.key === "Escape" && !event.repeat) stop(); }, true);
part.stop.addEventListener("click", stop);

function hear(told) {
  if (told instanceof ArrayBuffer) {
    age.gives(newest ? newest + run.wall : -Infinity);
    handle.send_rrd_to_channel(CHANNEL, new Uint8Array(told)); // each message is a whole stream
  } else if (told.kind === "run") {
    run = told;
    document.title = told.name;
    text(part.name, told.name);
  } else if (told.kind === "part") newest = told.newest;
  else if (told.kind === "now") now = told;
}

// Why the picture isn't of now, in words; empty if it is. `ms`: its age.
function old(ms) {
  if (failure) return failure;
  if (!link) return "The viewer is being loaded (43 MB)";
  if (now && now.condition === "ended") return "The run has ended: this is its past";
  if (!link.socket) return "The connection is lost: this is the past. If the terminal prints a new address, open that";
  if (!now || !run) return "Nothing was heard of the run yet";
  if (now.condition === "silent") return `${now.words}: this is the past`;
  if (run.wall === null) return now.words;
  if (age.time === null || age.timeline !== "time") return age.timeline ? `Old or new? The viewer goes by '${age.timeline}', not by 'time'` : "The first picture is being drawn";
  if (Math.abs(ms) <= LATE) return "";
  if (!(ms > 0)) return "How old the picture is isn't known"; // no answer of the server's clock yet, or clocks that disagree
  const words = `OLD PICTURE: ${(ms / 1000).toFixed(1)} s ago`;
  const quiet = (performance.now() - link.heard) / 1000;
  if (1000 * quiet > LATE) return `${words}. Nothing was heard of the run for ${quiet.toFixed(1)} s`;
  return age.plays ? `${words}. This machine draws slowly` : `${words}. The viewer is paused: its second button below follows the run`;
}

// Puts the red frame off until the picture is old. Only for another picture: what is set anew in each frame of the
// page never begins in the compositor.
function arm(time, ms) {
  if (time === armed) return;
  armed = time;
  const before = alarms, delay = Math.max(0, LATE - ms) || 0;
  alarms = [part.old, part.words].map((e) => e.animate([{ opacity: 0 }, { opacity: 1 }], { delay, duration: 1, fill: "both" }));
  if (time === NOT) alarms.forEach((alarm) => alarm.finish());
  before.forEach((alarm) => alarm.cancel());
}

function frame() {
  if (age) age.frame();
  check();
  requestAnimationFrame(frame);
}

function check() {
  if (handle && !failure && handle.has_panicked()) failure = "rerun's viewer has failed: load the page again";
  const ms = age && run && run.wall !== null && age.time !== null ? link.time(performance.now()) - (age.time - run.wall) : NaN;
  const words = old(ms);
  text(part.words, words || "OLD PICTURE: more than 1 s ago");
  arm(words ? NOT : age.time, ms);
  text(part.age, words ? "not of now" : `${(ms / 1000).toFixed(1)} s ago`);
  text(part.note, stopWords || (now && now.condition !== "ended" && now.condition !== "silent" ? now.words : ""));
  globalThis.viewerNow = { words, ms, note: part.note.textContent, time: age && age.time, plays: age && age.plays, timeline: age && age.timeline, loaded: performance.now() - began };
}

async function begin() {
  frame();
  setInterval(check, CHECK);
  await wasm_bindgen({ module_or_path: fetch("/re_viewer_bg.wasm") });
  const heard = [];
  handle = new wasm_bindgen.WebHandle({
    theme: "dark", hide_welcome_screen: true, enable_history: false, check_for_updates_on_startup: false,
    render_backend: "webgl", // whose frames can be followed to the screen
    on_viewer_event: (said) => (age ? age.hear(said) : heard.push(said)),
  });
  await handle.start(part.viewer);
  handle.open_channel(CHANNEL, "srl");
  age = new Age(part.viewer.getContext("webgl2"), () => link.say({ kind: "drawn" }));
  heard.forEach((said) => age.hear(said));
  link = new Link(hear, () => {});
}

begin().catch((error) => { failure = `The viewer can't begin (${error}). It needs a browser with WebGL 2`; });
