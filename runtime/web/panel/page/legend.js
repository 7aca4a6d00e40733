// What the colours of the picture are. A press hides or shows a thing.
import { button, made } from "/part.js";

export class Legend {
  constructor(part, eye) { [this.part, this.eye] = [part, eye]; }

  show({ things, ramp }) {
    const seen = new Map(); // colour by name; null: by distance
    for (const thing of [...things].sort((a, b) => (b.groups.length > 0) - (a.groups.length > 0))) {
      if (thing.groups.length) thing.groups.forEach((name, i) => seen.set(name, [thing.colors[i], thing.name]));
      else seen.set(thing.said, [thing.colors[0] ?? null, thing.name]);
    }
    this.part.legend.replaceChildren(...[...seen].map(([name, [color, signal]]) => {
      const line = made("li"), dot = made("i"), shows = button("", () => {
        this.eye.hidden.has(name) ? this.eye.hidden.delete(name) : this.eye.hidden.add(name);
        shows.setAttribute("aria-pressed", String(!this.eye.hidden.has(name)));
      });
      shows.setAttribute("aria-pressed", String(!this.eye.hidden.has(name)));
      shows.title = signal;
      if (color) dot.style.background = `rgb(${color.join(",")})`;
      else dot.className = "ramped";
      shows.append(dot, name);
      line.append(shows);
      return line;
    }));
    const { ramp: box, ramp_bar: bar, ramp_ends: ends } = this.part, last = ramp[ramp.length - 1][0];
    box.hidden = things.every((thing) => thing.colors.length);
    bar.style.background = `linear-gradient(to right, ${ramp.map(([m, c]) => `rgb(${c.join(",")}) ${100 * m / last}%`).join(",")})`;
    ends.replaceChildren(...["touches", `${last} m and more`].map((words) => made("span", "", words)));
  }
}
