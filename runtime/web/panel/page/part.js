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
