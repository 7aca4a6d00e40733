// How old the picture is that rerun's viewer has on the screen.
//
// The viewer says which time it shows. A frame of it is on the screen once the graphics have finished it, which on a
// machine without a graphics card is seconds later: a fence behind the frame's commands tells.

const SAME = 1; // ms by which times may differ for their number format
const LEFT = 2; // frames of the page after which the viewer has drawn what it was given before

export class Age {
  // drawn(): the part that was given by `gives` is on the screen.
  constructor(gl, drawn) {
    [this.gl, this.drawn] = [gl, drawn];
    this.time = null; // of the picture on the screen, Unix ms; null: unknown
    this.timeline = ""; // that the viewer goes by
    this.plays = true;
    this.told = null; // the newest time that the viewer has said
    this.part = null; // what was given and isn't drawn yet: {newest, left}
    this.fences = []; // {sync, time, part}, the oldest first
  }

  // The viewer was given data. `newest`: its newest time, Unix ms; -Infinity: it has none.
  gives(newest) { this.part = { newest, left: LEFT }; }

  // What the viewer says of itself, as JSON.
  hear(text) {
    const said = JSON.parse(text);
    if (said.type === "timeline_change") this.timeline = said.timeline;
    if (said.type === "play" || said.type === "pause") this.plays = said.type === "play";
    if (said.type === "timeline_change" || said.type === "time_update") this.told = said.time / 1e6;
  }

  // Called in each frame of the page, so behind what the viewer drew in the frame before.
  frame() {
    const part = this.taken() ? this.part : null;
    if (part) this.part = null;
    const newest = this.fences.length ? this.fences[this.fences.length - 1].time : this.time;
    if (part || this.told !== newest) {
      this.fences.push({ sync: this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0), time: this.told, part });
      this.gl.flush();
    }
    while (this.fences.length && this.finished(this.fences[0].sync)) {
      const { sync, time, part } = this.fences.shift();
      this.gl.deleteSync(sync);
      this.time = time;
      if (part) this.drawn();
    }
  }

  // Whether the viewer has taken in what it was given. It follows the newest time, unless somebody looks at the past:
  // then it gets nothing more. By another timeline it can't be known.
  taken() {
    if (!this.part || (this.part.left && this.part.left--)) return false;
    return this.part.newest === -Infinity || (this.timeline && this.timeline !== "time") || this.told >= this.part.newest - SAME;
  }

  finished(sync) { return this.gl.isContextLost() || this.gl.getSyncParameter(sync, this.gl.SYNC_STATUS) === this.gl.SIGNALED; }
}
