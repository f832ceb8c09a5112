// A figure with a title, its drawing, which follows the width of the page, and buttons that copy it.

import { copyCsv, copyPng, copySvg } from "./copying.js";
import { button, drawn, element } from "./dom.js";

// `draw(width)` returns an <svg>; `csv()` returns rows of cells. Where a pager shows a part, `all(width, isPrint)` returns the
// <svg> of every part: copies and prints have them. Returns a function that draws the figure again.
export function figure(place, { title, notes = [], controls = [], legend = null, draw, all = (width) => [draw(width)], csv }) {
  const drawing = element("div", { class: "drawing" });
  const copies = element("span", { class: "copies" }, "Copy as ",
    button("CSV", () => csv().then ? csv().then(copyCsv) : copyCsv(csv()), { "aria-label": `Copy ${title} as CSV` }),
    button("PNG", () => copied(copyPng), { "aria-label": `Copy ${title} as PNG` }),
    button("SVG", () => copied(copySvg), { "aria-label": `Copy ${title} as SVG` }));
  place.append(element("figure", {},
    element("figcaption", {}, element("strong", {}, title), ...notes.map((note) => element("span", { class: "small" }, note))),
    ...(controls.length ? [element("div", { class: "controls" }, ...controls)] : []),
    ...(legend ? [legend] : []), drawing, copies));
  let [width, printing] = [0, false];
  const copied = async (copy) => {
    if (!width) return copy(null);
    const hidden = element("div", { class: "drawing", style: "position: absolute; visibility: hidden", "aria-hidden": "true" });
    place.append(hidden); // styles are those of the page
    const whole = wholeOf({ title, notes, legend, parts: all(width) }, width);
    hidden.append(whole);
    await copy(whole);
    return hidden.remove();
  };
  const again = () => {
    const focused = drawing.contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
    drawing.replaceChildren(...(printing ? all(width, true) : [draw(width)]));
    if (focused) [...drawing.querySelectorAll("[aria-label]")].find((each) => each.getAttribute("aria-label") === focused)?.focus();
  };
  new ResizeObserver(() => {
    const wide = Math.floor(drawing.clientWidth);
    if (!wide || wide === width) return;
    width = wide;
    again();
  }).observe(drawing);
  for (const [event, begins] of [["beforeprint", true], ["afterprint", false]]) {
    window.addEventListener(event, () => {
      printing = begins;
      if (width && drawing.isConnected) again();
    });
  }
  return () => width && again();
}

const LINE = 18;

// A figure as one drawing: title, notes, legend, and every part below each other.
function wholeOf({ title, notes, legend, parts }, width) {
  const svg = drawn("svg", { "aria-label": title });
  let [top, wide] = [LINE, 7.1 * Math.max(title.length, ...notes.map((note) => note.length))];
  svg.append(text(0, top - 4, title, { class: "value" }));
  for (const note of notes) svg.append(text(0, (top += LINE) - 4, note, { class: "tick" }));
  let x = 0;
  if (legend) top += LINE;
  for (const item of legend?.children ?? []) {
    const [sample, name] = [item.firstElementChild, item.lastChild.textContent];
    const needed = 24 + 7.1 * name.length + 16;
    if (x && x + needed > width) [x, top] = [0, top + LINE];
    svg.append(sampleOf(sample, x, top - LINE + 4), text(x + 24, top - 3, name));
    x += needed;
    wide = Math.max(wide, x);
  }
  top += 8;
  for (const part of parts) {
    part.setAttribute("y", top);
    svg.append(part);
    top += Number(part.getAttribute("height"));
  }
  wide = Math.ceil(Math.max(wide, ...parts.map((part) => Number(part.getAttribute("width")))));
  for (const [name, value] of Object.entries({ viewBox: `0 0 ${wide} ${top}`, width: wide, height: top })) svg.setAttribute(name, value);
  return svg;
}

// The sample of a legend's item: its shape, or its colour with its letter.
function sampleOf(sample, x, y) {
  const group = drawn("g", { transform: `translate(${x} ${y})` });
  if (sample instanceof SVGElement) group.append(...[...sample.cloneNode(true).children]);
  else {
    const box = drawn("g", { class: "part", style: sample.getAttribute("style") }, drawn("rect", { width: 18, height: 14 }));
    box.append(text(9, 11, sample.textContent, { class: "mark", "text-anchor": "middle" }));
    group.append(box);
  }
  return group;
}

export function canvas(width, height, label) {
  return drawn("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "group", "aria-label": label });
}

export const text = (x, y, words, attributes = {}) => drawn("text", { x, y, ...attributes }, words);
export const path = (d, attributes = {}) => drawn("path", { d, ...attributes });

// Shapes and colours of the configurations, which are also distinct without colour.
const SHAPES = [
  (x, y, r) => `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`,
  (x, y, r) => `M${x - r} ${y - r}h${2 * r}v${2 * r}h${-2 * r}z`,
  (x, y, r) => `M${x} ${y - 1.3 * r}L${x + 1.2 * r} ${y + r}H${x - 1.2 * r}z`,
  (x, y, r) => `M${x} ${y - 1.35 * r}L${x + 1.35 * r} ${y}L${x} ${y + 1.35 * r}L${x - 1.35 * r} ${y}z`,
  (x, y, r) => `M${x} ${y + 1.3 * r}L${x + 1.2 * r} ${y - r}H${x - 1.2 * r}z`,
];
export const hue = (number) => `c${number % 8}`;
export const marker = (x, y, number, r = 4.5) => path(SHAPES[number % SHAPES.length](x, y, r), { class: `mark ${hue(number)}` });

export function legendOf(configurations) {
  return element("ul", { class: "legend" }, ...configurations.map(({ name, number }) => {
    const sample = drawn("svg", { viewBox: "0 0 16 14", width: 16, height: 14, "aria-hidden": "true" }, marker(8, 7, number));
    return element("li", {}, sample, name);
  }));
}

// Ticks of an axis at round numbers between two values.
export function ticks(low, high, most) {
  const raw = (high - low) / Math.max(most, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const stepSize = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= raw);
  const found = [];
  for (let value = Math.ceil(low / stepSize) * stepSize; value <= high + 1e-9; value += stepSize) found.push(Number(value.toFixed(9)));
  return found;
}

// Width of the longest of some words, at most a share of the total width.
export function gutter(list, width, share = 0.4) {
  return Math.min(24 + 7.1 * Math.max(...list.map((each) => each.length), 4), share * width);
}

// Words of at most so many characters: of longer ones the middle is left out, since names differ at either end.
export function shortened(words, most) {
  if (words.length <= most) return words;
  const end = Math.floor((most - 1) / 2);
  return `${words.slice(0, most - 1 - end)}…${words.slice(words.length - end)}`;
}

export const fitted = (words, width) => shortened(words, Math.max(Math.floor(width / 7.1), 3));

// A name with its value in one line, of which the name is shortened.
export const withValue = (name, value, width) => `${fitted(name, width - 7.1 * (value.length + 2))}  ${value}`;
