// Curves over the last seconds: one canvas for each plot, with all names, a time axis, and the values at a time.
import { ink, made, text } from "/part.js";

const SPAN = 20000, TICK = 5000; // ms that are shown, and between marks
const MOST = 60 * SPAN / 1000 + 200; // samples that are kept
const GAP = 400; // ms without a sample that break a curve
const LEFT = 54, RIGHT = 14, TOP = 8, BOTTOM = 20; // pixels around the curves

export class Curves {
  constructor(parent, pause) {
    [this.parent, this.pause] = [parent, pause];
    this.plots = [];
    this.palette = [[255, 255, 255]];
    this.at = null; // ms before the right edge at which the values are shown; null: nowhere
    this.held = null; // the time at the right edge while they are paused
    this.light = matchMedia("(prefers-color-scheme: light)");
    pause.addEventListener("click", () => this.hold(this.held === null ? this.now : null));
  }

  show(plots, palette) {
    this.palette = palette;
    this.hold(null);
    this.plots.forEach(({ box }) => box.remove());
    this.plots = plots.map((plot) => {
      const box = made("figure"), canvas = made("canvas"), names = made("ul"), title = made("figcaption", "", `${plot.title}${plot.unit && plot.unit !== "1" ? `, ${plot.unit}` : ""}`);
      const dots = plot.labels.map((label, i) => {
        const line = made("li"), dot = made("i", i >= palette.length ? "dashed" : ""), value = made("output");
        line.append(dot, made("span", "", label), value);
        names.append(line);
        return { dot, value };
      });
      canvas.tabIndex = 0;
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `${plot.title}: ${plot.labels.join(", ")} over the last ${SPAN / 1000} s. The arrow keys show the values at a time.`);
      canvas.addEventListener("pointermove", (e) => this.point(canvas, e.offsetX));
      canvas.addEventListener("pointerleave", () => { this.at = null; });
      canvas.addEventListener("keydown", (e) => this.pressed(e));
      canvas.addEventListener("blur", () => { this.at = null; });
      box.append(title, names, canvas);
      this.parent.append(box);
      return { ...plot, box, canvas, dots, samples: [] };
    });
  }

  point(canvas, x) {
    const share = (x - LEFT) / (canvas.clientWidth - LEFT - RIGHT);
    this.at = share >= 0 && share <= 1 ? (1 - share) * SPAN : null;
  }

  pressed(e) {
    const by = { ArrowLeft: 200, ArrowRight: -200 }[e.key];
    if (!by) return;
    this.at = Math.min(Math.max((this.at ?? 0) + by, 0), SPAN);
    e.preventDefault();
  }

  // Holds the curves at a time; null: they go on. Samples are taken all the same.
  hold(time) {
    this.held = time ?? null;
    for (const plot of this.plots) plot.kept = this.held === null ? null : [...plot.samples];
    this.pause.setAttribute("aria-pressed", String(this.held !== null));
    text(this.pause, this.held === null ? "Pause the curves" : "Paused: go on");
  }

  take(t, values) {
    this.plots.forEach((plot, i) => {
      plot.samples.push([t, values[i]]);
      if (plot.samples.length > MOST) plot.samples.splice(0, plot.samples.length - MOST);
    });
  }

  draw(now) {
    this.now = now;
    const style = getComputedStyle(document.body);
    this.colors = { grid: style.getPropertyValue("--line"), text: style.getPropertyValue("--quiet") };
    for (const plot of this.plots) this.plot(plot, this.held ?? now);
  }

  plot(plot, now) {
    const box = plot.canvas.getBoundingClientRect();
    if (box.bottom < 0 || box.top > innerHeight || !box.width) return; // out of sight
    const c = plot.canvas.getContext("2d"), ratio = devicePixelRatio || 1;
    const size = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (plot.canvas.width !== size[0] || plot.canvas.height !== size[1]) [plot.canvas.width, plot.canvas.height] = size;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, box.width, box.height);
    const w = box.width - LEFT - RIGHT, h = box.height - TOP - BOTTOM;
    const shown = (plot.kept ?? plot.samples).filter(([t]) => t > now - SPAN && t <= now);
    let [low, high] = [Infinity, -Infinity];
    for (const [, values] of shown) for (const v of values) if (v !== null) [low, high] = [Math.min(low, v), Math.max(high, v)];
    if (!(low <= high)) [low, high] = [0, 1];
    const margin = Math.max(0.06 * (high - low), 1e-6 + 0.01 * Math.max(Math.abs(low), Math.abs(high)));
    [low, high] = [low - margin, high + margin];
    const x = (t) => LEFT + w * (1 - (now - t) / SPAN), y = (v) => TOP + h * (1 - (v - low) / (high - low));
    this.axes(c, w, h, low, high, x, y, now);
    c.save();
    c.beginPath();
    c.rect(LEFT, TOP, w, h);
    c.clip();
    plot.labels.forEach((_, i) => this.curve(c, plot, i, shown, x, y));
    c.restore();
    this.values(c, plot, shown, now, x, h);
  }

  color(i) { return `rgb(${ink(this.palette[i % this.palette.length], this.light.matches).join(",")})`; }

  curve(c, plot, i, shown, x, y) {
    const { dot } = plot.dots[i], color = this.color(i);
    if (dot.style.color !== color) dot.style.color = color;
    c.strokeStyle = color;
    c.lineWidth = 1.6;
    c.setLineDash(i >= this.palette.length ? [5, 3] : []);
    c.beginPath();
    let before = -Infinity;
    for (const [t, values] of shown) {
      if (values[i] === null) { before = -Infinity; continue; }
      if (t - before > GAP) c.moveTo(x(t), y(values[i]));
      else c.lineTo(x(t), y(values[i]));
      before = t;
    }
    c.stroke();
    c.setLineDash([]);
  }

  // The values under the pointer, or the newest.
  values(c, plot, shown, now, x, h) {
    const wanted = this.at === null ? Infinity : now - this.at;
    let found = shown.at(-1);
    for (const sample of this.at === null ? [] : shown) if (Math.abs(sample[0] - wanted) < Math.abs(found[0] - wanted)) found = sample;
    plot.dots.forEach(({ value }, i) => {
      const v = found ? found[1][i] : null, words = v === null || v === undefined ? "–" : short(v);
      if (value.textContent !== words) value.textContent = words;
    });
    if (this.at === null || !found) return;
    c.strokeStyle = c.fillStyle = this.colors.text;
    c.beginPath();
    c.moveTo(x(found[0]), TOP);
    c.lineTo(x(found[0]), TOP + h);
    c.stroke();
    const words = `${((found[0] - now) / 1000).toFixed(2)} s`, half = c.measureText(words).width / 2;
    const at = Math.min(Math.max(x(found[0]), LEFT + half), x(now) - half);
    c.clearRect(at - half - 3, TOP + h + 1, 2 * half + 6, BOTTOM);
    c.textAlign = "center";
    c.fillText(words, at, TOP + h + 11);
  }

  axes(c, w, h, low, high, x, y, now) {
    c.font = "12px system-ui, 'DejaVu Sans', sans-serif";
    c.textBaseline = "middle";
    c.fillStyle = this.colors.text;
    c.strokeStyle = this.colors.grid;
    c.lineWidth = 1;
    c.textAlign = "right";
    const step = nice((high - low) / Math.max(h / 40, 1));
    for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
      line(c, LEFT, y(v), LEFT + w, y(v));
      c.fillText(`${Number(v.toFixed(6))}`, LEFT - 6, y(v));
    }
    c.textAlign = "center";
    for (let back = 0; back <= SPAN; back += TICK) {
      line(c, x(now - back), TOP, x(now - back), TOP + h + 4);
      if (back === 0) c.textAlign = "right";
      c.fillText(back === 0 ? (this.held === null ? "now" : "paused") : `−${back / 1000} s`, back === 0 ? x(now) + RIGHT - 2 : x(now - back), TOP + h + 11);
      c.textAlign = "center";
    }
  }
}

function line(c, ...[x0, y0, x1, y1]) {
  c.beginPath();
  c.moveTo(x0, y0);
  c.lineTo(x1, y1);
  c.stroke();
}

function short(v) { return Math.abs(v) >= 1e5 || (v !== 0 && Math.abs(v) < 1e-3) ? v.toExponential(2) : `${Number(v.toPrecision(4))}`; }

function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return power * [1, 2, 5, 10].find((k) => k * power >= step * 0.999);
}
