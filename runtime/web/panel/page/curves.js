// Curves over the last seconds, one canvas for each plot.

const SPAN = 20000; // ms that are shown
const MOST = 60 * SPAN / 1000 + 200; // samples that are kept
const GRID = "#1d262f", TEXT = "#9aa7b4", LOUD = "#e8edf2", GAP = 400; // ms without a sample that break a curve

export class Curves {
  constructor(parent) {
    this.parent = parent;
    this.plots = [];
    this.palette = [[255, 255, 255]];
  }

  show(plots, palette) {
    this.palette = palette;
    this.parent.replaceChildren();
    this.plots = plots.map((plot) => {
      const canvas = document.createElement("canvas");
      this.parent.append(canvas);
      return { ...plot, canvas, samples: [] };
    });
  }

  take(t, values) {
    this.plots.forEach((plot, i) => {
      plot.samples.push([t, values[i]]);
      if (plot.samples.length > MOST) plot.samples.splice(0, plot.samples.length - MOST);
    });
  }

  draw(now) { for (const plot of this.plots) this.plot(plot, now); }

  plot(plot, now) {
    const c = plot.canvas.getContext("2d"), ratio = devicePixelRatio || 1, box = plot.canvas.getBoundingClientRect();
    const size = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (plot.canvas.width !== size[0] || plot.canvas.height !== size[1]) [plot.canvas.width, plot.canvas.height] = size;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, box.width, box.height);
    const left = 54, right = 12, top = 26, bottom = 8, w = box.width - left - right, h = box.height - top - bottom;
    const shown = plot.samples.filter(([t]) => t > now - SPAN);
    let [low, high] = [Infinity, -Infinity];
    for (const [, values] of shown) for (const v of values) if (v !== null) [low, high] = [Math.min(low, v), Math.max(high, v)];
    if (!(low <= high)) [low, high] = [0, 1];
    const margin = Math.max(0.06 * (high - low), 1e-6 + 0.01 * Math.max(Math.abs(low), Math.abs(high)));
    [low, high] = [low - margin, high + margin];
    const x = (t) => left + w * (1 - (now - t) / SPAN), y = (v) => top + h * (1 - (v - low) / (high - low));
    this.axes(c, plot, box.width, left, w, top, h, low, high, y);
    c.save();
    c.beginPath();
    c.rect(left, top, w, h);
    c.clip();
    plot.labels.forEach((_, i) => {
      const color = this.palette[i % this.palette.length];
      c.strokeStyle = `rgb(${color.join(",")})`;
      c.lineWidth = 1.6;
      c.beginPath();
      let before = -Infinity;
      for (const [t, values] of shown) {
        if (values[i] === null) { before = -Infinity; continue; }
        if (t - before > GAP) c.moveTo(x(t), y(values[i]));
        else c.lineTo(x(t), y(values[i]));
        before = t;
      }
      c.stroke();
    });
    c.restore();
  }

  axes(c, plot, width, left, w, top, h, low, high, y) {
    c.font = "12px system-ui, 'DejaVu Sans', sans-serif";
    c.textBaseline = "middle";
    c.fillStyle = TEXT;
    c.strokeStyle = GRID;
    c.lineWidth = 1;
    c.textAlign = "right";
    const step = nice((high - low) / 3);
    for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
      c.beginPath();
      c.moveTo(left, y(v));
      c.lineTo(left + w, y(v));
      c.stroke();
      c.fillText(`${Number(v.toFixed(6))}`, left - 6, y(v));
    }
    c.textAlign = "left";
    c.fillStyle = LOUD;
    const title = `${plot.title} (${plot.unit})`;
    c.fillText(title, 10, 13);
    let at = width - 12;
    c.textAlign = "right";
    for (let i = plot.labels.length - 1; i >= 0; i--) { // from the right, as far as there is room
      const needed = c.measureText(plot.labels[i]).width + 14;
      if (at - needed < 24 + c.measureText(title).width) break;
      c.fillStyle = `rgb(${this.palette[i % this.palette.length].join(",")})`;
      c.fillText(plot.labels[i], at, 13);
      at -= needed;
    }
  }
}

function nice(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return power * [1, 2, 5, 10].find((k) => k * power >= step * 0.999);
}
