// Small helpers of the page's parts. Words from elsewhere become text, never markup.

export function text(element, words) {
  if (element.textContent !== words) element.textContent = words;
  element.hidden = !words;
}

export function made(kind, name, words = "") {
  const element = document.createElement(kind);
  if (name) element.className = name;
  if (words) element.textContent = words;
  return element;
}

export function button(words, pressed) {
  const element = made("button", "", words);
  element.type = "button";
  if (pressed) element.addEventListener("click", pressed);
  return element;
}

// A number with its unit: the unit 1 isn't said, and 1/m is "per m".
export function measure(value, unit, digits = 3) {
  if (value === null) return "-";
  return `${Number(value.toFixed(digits))} ${unit === "1" ? "" : unit.replace(/^1\//, "per ")}`.trim();
}

// A distance's colour, m: linear between the ramp's; `unknown` where it is none.
export function shade(ramp, unknown, distance) {
  if (distance === null) return unknown;
  const next = ramp.findIndex(([m]) => distance < m);
  if (next <= 0) return ramp.at(next)[1]; // before the first, or behind the last
  const [[low, from], [high, to]] = [ramp[next - 1], ramp[next]], k = (distance - low) / (high - low);
  return from.map((c, i) => Math.round(c + k * (to[i] - c)));
}

// A colour that is chosen for a dark ground, as it is drawn on this one.
export function ink([r, g, b], light) {
  const bright = (0.3 * r + 0.59 * g + 0.11 * b) / 255, k = light && bright > 0.45 ? 0.45 / bright : 1;
  return [r, g, b].map((c) => Math.round(c * k));
}
