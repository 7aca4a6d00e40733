// What stands in space: points with links, and capsules, seen from an eye that can be turned. Lengths in m, z up.

const GROUND = "#0e1318", GRID = "#1f2932", OLD = [120, 128, 136];
const OPEN = 0.55; // rad, the eye's angle of view
const FIRST = [-0.6, 0.3]; // rad, the first look: from x, which is the front, a little from the right; how far above
const NEAR = 0.05; // m before the eye

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const less = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const times = (a, k) => [k * a[0], k * a[1], k * a[2]];
const rgba = (c, a) => `rgba(${c[0]},${c[1]},${c[2]},${a})`;

export class Space {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    [this.turn, this.tilt] = FIRST;
    this.target = null; // where the eye looks; null: at the middle of what is there
    this.middle = null;
    this.distance = 0;
    this.shift = [0, 0, 0];
    this.follow = true;
    this.drawn = { points: 0, links: 0, capsules: 0 };
    this.listen();
  }

  listen() {
    let held = null;
    this.canvas.addEventListener("pointerdown", (e) => { held = [e.clientX, e.clientY]; this.canvas.setPointerCapture(e.pointerId); });
    this.canvas.addEventListener("pointerup", () => { held = null; });
    this.canvas.addEventListener("pointermove", (e) => {
      if (!held) return;
      const [dx, dy] = [e.clientX - held[0], e.clientY - held[1]];
      held = [e.clientX, e.clientY];
      if (e.shiftKey) {
        const k = this.distance / this.scale;
        this.shift = add(this.shift, add(times(this.right, -dx * k), times(this.up, dy * k)));
      } else {
        this.look(this.turn - dx * 0.008, this.tilt + dy * 0.008);
      }
    });
    this.canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.distance *= Math.exp(e.deltaY * 0.001); }, { passive: false });
    this.canvas.addEventListener("dblclick", () => this.first());
  }

  look(turn, tilt) { [this.turn, this.tilt] = [turn, Math.min(Math.max(tilt, -1.55), 1.55)]; }

  first() {
    this.look(...FIRST);
    [this.target, this.distance, this.shift] = [null, 0, [0, 0, 0]];
  }

  // Looks at the middle of the things; slowly after them, if it follows.
  aim(points) {
    if (!points.length) return;
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    for (const p of points) for (let i = 0; i < 3; i++) { low[i] = Math.min(low[i], p[i]); high[i] = Math.max(high[i], p[i]); }
    const middle = times(add(low, high), 0.5), reach = Math.hypot(...less(high, low)) / 2;
    if (!this.target || !this.distance) {
      this.target = middle;
      this.distance = Math.max(1.12 * reach / Math.sin(OPEN / 2), 0.1);
      this.floor = low[2];
    } else if (this.follow) {
      this.target = add(this.target, times(less(middle, this.target), 0.05));
    }
  }

  prepare() {
    const ratio = devicePixelRatio || 1, box = this.canvas.getBoundingClientRect();
    [this.width, this.height] = [box.width, box.height];
    const size = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.scale = Math.min(this.width, this.height) / 2 / Math.tan(OPEN / 2);
    const [c, s] = [Math.cos(this.tilt), Math.sin(this.tilt)];
    this.back = [Math.cos(this.turn) * c, Math.sin(this.turn) * c, s]; // from the target to the eye
    this.right = [-Math.sin(this.turn), Math.cos(this.turn), 0];
    this.up = [-Math.cos(this.turn) * s, -Math.sin(this.turn) * s, c];
    this.eye = add(add(this.target || [0, 0, 0], this.shift), times(this.back, this.distance || 1));
  }

  // [x, y in pixels, pixels a metre there, depth]; null if it is behind the eye.
  project(p) {
    const v = less(p, this.eye), depth = -dot(v, this.back);
    if (!(depth > NEAR)) return null;
    const k = this.scale / depth;
    return [this.width / 2 + dot(v, this.right) * k, this.height / 2 - dot(v, this.up) * k, k, depth];
  }

  // things: from the scene; values: of a frame; live(thing): whether it is there now as it is drawn.
  draw(things, values, live) {
    const read = things.map((thing, i) => (thing.points ? triples(values[i]) : capsules(values[i])));
    const all = [];
    things.forEach((thing, i) => {
      if (thing.points) all.push(...read[i].filter(Boolean));
      else for (const c of read[i]) if (c) all.push(c.from, c.to);
    });
    this.aim(all);
    this.prepare();
    this.context.fillStyle = GROUND;
    this.context.fillRect(0, 0, this.width, this.height);
    if (!this.target) return;
    this.grid();
    const jobs = [];
    this.drawn = { points: 0, links: 0, capsules: 0 };
    things.forEach((thing, i) => (thing.points ? this.points : this.capsules).call(this, thing, read[i], live(thing), jobs));
    jobs.sort((a, b) => b.depth - a.depth);
    for (const job of jobs) job.paint();
  }

  points(thing, places, live, jobs) {
    const c = this.context, seen = places.map((p) => p && this.project(p));
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
    for (const place of places) {
      const [a, b] = place ? [this.project(place.from), this.project(place.to)] : [];
      if (!a || !b) continue;
      this.drawn.capsules++;
      const color = live ? place.color : OLD, least = thing.solid ? 2 : 0;
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
    const c = this.context, middle = this.target.map((x) => Math.round(x));
    c.strokeStyle = GRID;
    c.lineWidth = 1;
    for (let i = -4; i <= 4; i++) {
      for (const [from, to] of [[[i, -4], [i, 4]], [[-4, i], [4, i]]]) {
        const [a, b] = [from, to].map((p) => this.project([middle[0] + p[0], middle[1] + p[1], this.floor]));
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
  for (let i = 0; i < flat.length; i += 10) {
    const v = flat.slice(i, i + 10);
    found.push(v.includes(null) ? null : { from: v.slice(0, 3), to: v.slice(3, 6), radius: v[6], color: v.slice(7) });
  }
  return found;
}
