// What stands in space, on a flat canvas: the picture where there is no three.js or no WebGL. Lengths in m, z up.
import { less } from "/eye.js";
import { shade } from "/part.js";

const OLD = [120, 128, 136], NEAR = 0.05; // m before the eye
const THEMES = { dark: ["#0e1318", "#1f2932"], light: ["#f1f4f7", "#ccd4db"] }; // ground, grid

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const rgba = (c, a) => `rgba(${c[0]},${c[1]},${c[2]},${a})`;

export class Space {
  constructor(canvas, eye) {
    [this.canvas, this.eye] = [canvas, eye];
    this.context = canvas.getContext("2d");
    this.light = matchMedia("(prefers-color-scheme: light)");
    this.drawn = { points: 0, links: 0, capsules: 0 };
  }

  prepare() {
    const ratio = devicePixelRatio || 1, box = this.canvas.getBoundingClientRect();
    [this.width, this.height] = [box.width, box.height];
    const size = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.scale = this.eye.scale();
    Object.assign(this, this.eye.axes());
    this.from = this.eye.place();
  }

  // [x, y in pixels, pixels a metre there, depth]; null if it is behind the eye.
  project(p) {
    const v = less(p, this.from), depth = -dot(v, this.back);
    if (!(depth > NEAR)) return null;
    const k = this.scale / depth;
    return [this.width / 2 + dot(v, this.right) * k, this.height / 2 - dot(v, this.up) * k, k, depth];
  }

  // scene: what the server said once; values: of a frame of it; live(thing): whether it is of now.
  draw(scene, { things: values }, live) {
    const { things } = this.scene = scene, { eye } = this, read = things.map((thing, i) => (thing.points ? triples(values[i]) : capsules(values[i])));
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    const grow = (p) => { for (let i = 0; i < 3; i++) [low[i], high[i]] = [Math.min(low[i], p[i]), Math.max(high[i], p[i])]; };
    things.forEach((thing, i) => read[i].forEach((found) => {
      if (found && thing.points) grow(found);
      else if (found) { grow(found.from); grow(found.to); }
    }));
    eye.aim(low, high);
    this.prepare();
    [this.context.fillStyle, this.lines] = THEMES[this.light.matches ? "light" : "dark"];
    this.context.fillRect(0, 0, this.width, this.height);
    if (!eye.target) return;
    this.grid();
    const jobs = [];
    this.drawn = { points: 0, links: 0, capsules: 0 };
    things.forEach((thing, i) => (thing.points ? this.points : this.capsules).call(this, thing, read[i], live(thing), jobs));
    jobs.sort((a, b) => b.depth - a.depth);
    for (const job of jobs) job.paint();
  }

  points(thing, places, live, jobs) {
    const c = this.context, off = (row) => this.eye.hidden.has(thing.groups[row] ?? thing.said);
    const seen = places.map((p, row) => p && !off(row) && this.project(p));
    const color = (row) => (live ? thing.colors[thing.colors.length > 1 ? row : 0] : OLD);
    for (const link of thing.links) {
      for (let k = 1; k < link.length; k++) {
        const [a, b] = [seen[link[k - 1]], seen[link[k]]];
        if (!a || !b) continue;
        this.drawn.links++;
        jobs.push({ depth: (a[3] + b[3]) / 2, paint: () => {
          c.strokeStyle = rgba(color(link[0]), 1);
          c.lineCap = "round";
          c.lineWidth = Math.max(2 * thing.radii[1] * (a[2] + b[2]) / 2, 1.2);
          c.beginPath();
          c.moveTo(a[0], a[1]);
          c.lineTo(b[0], b[1]);
          c.stroke();
        } });
      }
    }
    seen.forEach((p, row) => {
      if (!p) return;
      this.drawn.points++;
      jobs.push({ depth: p[3] - 0.005, paint: () => {
        c.fillStyle = rgba(color(row), 1);
        c.beginPath();
        c.arc(p[0], p[1], Math.max(thing.radii[0] * p[2], 1.3), 0, 2 * Math.PI);
        c.fill();
      } });
    });
  }

  capsules(thing, places, live, jobs) {
    const c = this.context;
    if (this.eye.hidden.has(thing.said)) return;
    for (const place of places) {
      const [a, b] = place ? [this.project(place.from), this.project(place.to)] : [];
      if (!a || !b) continue;
      this.drawn.capsules++;
      const color = live ? thing.colors[0] ?? shade(this.scene.ramp, this.scene.unknown, place.distance) : OLD, least = thing.solid ? 2 : 0;
      const [ra, rb] = [Math.max(place.radius * a[2], least), Math.max(place.radius * b[2], least)];
      const gap = thing.solid && !thing.colors.length; // the line across a gap lies on top of the capsules
      jobs.push({ depth: gap ? 0 : (a[3] + b[3]) / 2, paint: () => {
        outline(c, a, ra, b, rb);
        c.fillStyle = rgba(color, thing.solid ? 1 : 0.28);
        c.fill();
        if (thing.solid && !gap) return;
        c.strokeStyle = gap ? "#fff" : rgba(color, 0.9);
        c.lineWidth = gap ? 0.8 : 1.4;
        c.stroke();
      } });
    }
  }

  grid() {
    const c = this.context, middle = this.eye.target.map((x) => Math.round(x));
    c.strokeStyle = this.lines;
    c.lineWidth = 1;
    for (let i = -4; i <= 4; i++) {
      for (const [from, to] of [[[i, -4], [i, 4]], [[-4, i], [4, i]]]) {
        const [a, b] = [from, to].map((p) => this.project([middle[0] + p[0], middle[1] + p[1], this.eye.floor]));
        if (!a || !b) continue;
        c.beginPath();
        c.moveTo(a[0], a[1]);
        c.lineTo(b[0], b[1]);
        c.stroke();
      }
    }
  }
}

// The silhouette of a capsule: two circles and the tangents between them.
function outline(c, a, ra, b, rb) {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]], d = Math.hypot(dx, dy);
  c.beginPath();
  if (d <= Math.abs(ra - rb)) {
    const [p, r] = ra > rb ? [a, ra] : [b, rb];
    c.arc(p[0], p[1], r, 0, 2 * Math.PI);
    return;
  }
  const angle = Math.atan2(dy, dx), open = Math.acos((ra - rb) / d);
  c.arc(a[0], a[1], ra, angle + open, angle - open + 2 * Math.PI);
  c.arc(b[0], b[1], rb, angle - open, angle + open);
  c.closePath();
}

function triples(flat) {
  const found = [];
  for (let i = 0; i < flat.length; i += 3) found.push(flat[i] === null || flat[i + 1] === null || flat[i + 2] === null ? null : flat.slice(i, i + 3));
  return found;
}

function capsules(flat) {
  const found = [];
  for (let i = 0; i < flat.length; i += 8) {
    const v = flat.slice(i, i + 7);
    found.push(v.includes(null) ? null : { from: v.slice(0, 3), to: v.slice(3, 6), radius: v[6], distance: flat[i + 7] });
  }
  return found;
}
