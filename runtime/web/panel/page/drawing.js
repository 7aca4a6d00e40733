// What is drawn: the curve once, the pointer and its trace in every frame.

const CURVE = "#6cb6ff", TRACE = "#ff4d4f", OLD = "#8b96a1", GRID = "#1d262f", TEXT = "#9aa7b4";
const TOP = 0.2, BOTTOM = 0.16, LEFT = 0.08, RIGHT = 0.05; // shares of the window that stay free

export class Drawing {
  constructor(scene, live) {
    this.canvases = [scene, live];
    [this.scene, this.live] = this.canvases.map((canvas) => canvas.getContext("2d"));
    this.curve = null;
    this.trace = []; // [x 0..1, y 0..1, whether it followed]
    addEventListener("resize", () => this.resize());
    this.resize();
  }

  resize() {
    const scale = devicePixelRatio || 1;
    [this.width, this.height] = [innerWidth, innerHeight];
    for (const canvas of this.canvases) {
      canvas.width = Math.round(this.width * scale);
      canvas.height = Math.round(this.height * scale);
      canvas.getContext("2d").setTransform(scale, 0, 0, scale, 0, 0);
    }
    this.drawScene();
  }

  x(share) { return this.width * (LEFT + share * (1 - LEFT - RIGHT)); }
  y(value) { return this.height * (1 - BOTTOM - Math.min(Math.max(value, -0.04), 1.04) * (1 - TOP - BOTTOM)); }

  show(curve) {
    this.curve = curve;
    this.trace = [];
    this.drawScene();
  }

  drawScene() {
    const c = this.scene;
    c.clearRect(0, 0, this.width, this.height);
    c.font = "16px system-ui, 'DejaVu Sans', sans-serif";
    c.textAlign = "right";
    c.textBaseline = "middle";
    c.lineWidth = 1;
    for (const value of [0, 0.25, 0.5, 0.75, 1]) {
      c.strokeStyle = GRID;
      c.beginPath();
      c.moveTo(this.x(0), this.y(value));
      c.lineTo(this.x(1), this.y(value));
      c.stroke();
      c.fillStyle = TEXT;
      c.fillText(`${100 * value}`, this.x(0) - 34, this.y(value));
    }
    if (!this.curve) return;
    c.strokeStyle = CURVE;
    c.lineWidth = 5;
    c.lineJoin = c.lineCap = "round";
    c.beginPath();
    this.curve.forEach((value, i) => c.lineTo(this.x(i / (this.curve.length - 1)), this.y(value)));
    c.stroke();
  }

  // share: how far along the curve; value: null for none; follows: whether the pointer follows the participant.
  frame(share, value, follows, settling, tracing) {
    const c = this.live;
    c.clearRect(0, 0, this.width, this.height);
    if (tracing && value !== null) this.trace.push([share, value, follows]);
    this.drawTrace(c);
    if (settling && this.curve) {
      c.strokeStyle = CURVE;
      c.lineWidth = 3;
      c.beginPath();
      c.arc(this.x(0), this.y(this.curve[0]), 24, 0, 2 * Math.PI);
      c.stroke();
    }
    if (value === null) return;
    c.beginPath();
    c.arc(this.x(share), this.y(value), 13, 0, 2 * Math.PI);
    if (follows) {
      c.fillStyle = TRACE;
      c.fill();
      c.strokeStyle = "#fff";
      c.lineWidth = 2;
    } else {
      c.setLineDash([5, 5]);
      c.strokeStyle = OLD;
      c.lineWidth = 3;
    }
    c.stroke();
    c.setLineDash([]);
  }

  drawTrace(c) {
    c.lineWidth = 4;
    c.lineJoin = c.lineCap = "round";
    for (let i = 1; i < this.trace.length;) {
      const follows = this.trace[i][2];
      c.strokeStyle = follows ? TRACE : OLD;
      c.setLineDash(follows ? [] : [2, 9]);
      c.beginPath();
      c.moveTo(this.x(this.trace[i - 1][0]), this.y(this.trace[i - 1][1]));
      for (; i < this.trace.length && this.trace[i][2] === follows; i++) {
        c.lineTo(this.x(this.trace[i][0]), this.y(this.trace[i][1]));
      }
      c.stroke();
    }
    c.setLineDash([]);
  }
}
