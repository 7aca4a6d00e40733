// Where a picture is seen from, and how mouse, fingers and keys change that. Lengths in m, z up, angles in rad.

export const OPEN = 0.55; // rad, the angle of view over the narrower side
const FIRST = [-0.6, 0.3]; // the first look: from x, which is the front, a little from the right; how far above
const KEYS = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const less = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a, k) => [k * a[0], k * a[1], k * a[2]];

export class Eye {
  constructor(canvas) {
    this.canvas = canvas;
    this.follow = true;
    this.frames = false; // whether the frames' axes are shown
    this.hidden = new Set(); // what isn't shown, by its name in the legend
    this.fingers = new Map(); // pointers that are down: their places
    this.first();
    canvas.addEventListener("pointerdown", (e) => { this.fingers.set(e.pointerId, [e.clientX, e.clientY]); canvas.setPointerCapture(e.pointerId); });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(end, (e) => this.fingers.delete(e.pointerId));
    canvas.addEventListener("pointermove", (e) => this.moved(e));
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * 0.001)); }, { passive: false });
    canvas.addEventListener("dblclick", () => this.first());
    canvas.addEventListener("keydown", (e) => this.pressed(e));
  }

  first() {
    this.look(...FIRST);
    [this.target, this.distance, this.shift, this.floor, this.reach, this.own] = [null, 0, [0, 0, 0], 0, 0, false];
  }

  look(turn, tilt) { [this.turn, this.tilt] = [turn, Math.min(Math.max(tilt, -1.55), 1.55)]; }

  // What another picture of the same row depends on.
  view() { return [this.turn, this.tilt, this.distance, ...this.shift, this.frames, this.follow, ...this.hidden, this.canvas.clientWidth, this.canvas.clientHeight]; }

  zoom(factor) { this.distance *= factor; this.own = true; }

  // One finger turns, with shift it moves; two move and zoom.
  moved(e) {
    const before = this.fingers.get(e.pointerId);
    if (!before) return;
    const now = [e.clientX, e.clientY], [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const other = [...this.fingers].find(([id]) => id !== e.pointerId);
    this.fingers.set(e.pointerId, now);
    if (other) {
      const apart = (p) => Math.max(Math.hypot(p[0] - other[1][0], p[1] - other[1][1]), 1);
      this.zoom(apart(before) / apart(now));
      this.move(dx / 2, dy / 2);
    } else if (e.shiftKey) this.move(dx, dy);
    else this.look(this.turn - dx * 0.008, this.tilt + dy * 0.008);
  }

  move(dx, dy) {
    const { right, up } = this.axes(), k = this.distance / this.scale();
    this.shift = add(this.shift, add(times(right, -dx * k), times(up, dy * k)));
  }

  pressed(e) {
    if (e.altKey || e.ctrlKey || e.metaKey) return;
    const turn = KEYS[e.key];
    if (turn && e.shiftKey) this.move(200 * turn[0], -200 * turn[1]);
    else if (turn) this.look(this.turn + turn[0], this.tilt + turn[1]);
    else if (e.key === "+" || e.key === "-") this.zoom(e.key === "+" ? 0.9 : 1 / 0.9);
    else if (e.key === "Home") this.first();
    else return;
    e.preventDefault();
  }

  // Pixels that 1 m has at a distance of 1 m.
  scale() { return Math.min(this.canvas.clientWidth, this.canvas.clientHeight) / 2 / Math.tan(OPEN / 2); }

  // Looks at the middle of a box; slowly after it, if it follows. The first look shows all of it, also when it grows.
  aim(low, high) {
    if (!(low[0] <= high[0])) return;
    const middle = times(add(low, high), 0.5), [x, y, z] = less(high, low), wide = Math.hypot(x, y) / 2;
    const reach = Math.max(wide, z / 2, 0.02), needed = 1.1 * reach / Math.tan(OPEN / 2) + wide;
    if (!this.target || !this.distance) [this.target, this.floor, this.reach, this.needed] = [middle, low[2], 0, 0];
    else if (this.follow) this.target = add(this.target, times(less(middle, this.target), 0.05));
    this.reach = Math.max(this.reach, reach);
    this.floor = Math.min(this.floor, low[2]);
    this.needed = Math.max(this.needed, needed);
    if (!this.own) this.distance = this.needed;
  }

  // Unit vectors: back from the target to the eye, right and up on the screen.
  axes() {
    const [ct, st, c, s] = [Math.cos(this.turn), Math.sin(this.turn), Math.cos(this.tilt), Math.sin(this.tilt)];
    return { back: [ct * c, st * c, s], right: [-st, ct, 0], up: [-ct * s, -st * s, c] };
  }

  middle() { return add(this.target || [0, 0, 0], this.shift); }

  place() { return add(this.middle(), times(this.axes().back, this.distance || 1)); }
}
