// A figure with a title, its drawing, which follows the width of the page, and buttons that copy it.

import { copyCsv, copyPng, copySvg } from "./copying.js";
import { button, drawn, element } from "./dom.js";

// `draw(width)` returns an <svg>; `csv()` returns rows of cells. Returns a function that draws it again.
export function figure(place, { title, notes = [], controls = [], legend = null, draw, csv }) {
  const drawing = element("div", { class: "drawing" });
  const copies = element("span", { class: "copies" }, "Copy as ",
    button("CSV", () => csv().then ? csv().then(copyCsv) : copyCsv(csv()), { "aria-label": `Copy ${title} as CSV` }),
    button("PNG", () => copyPng(drawing.querySelector("svg")), { "aria-label": `Copy ${title} as PNG` }),
    button("SVG", () => copySvg(drawing.querySelector("svg")), { "aria-label": `Copy ${title} as SVG` }));
  place.append(element("figure", {},
    element("figcaption", {}, element("strong", {}, title), ...notes.map((note) => element("span", { class: "small" }, note))),
    ...(controls.length ? [element("div", { class: "controls" }, ...controls)] : []),
    ...(legend ? [legend] : []), drawing, copies));
  let width = 0;
  const again = () => {
    const focused = drawing.contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
    drawing.replaceChildren(draw(width));
    if (focused) [...drawing.querySelectorAll("[aria-label]")].find((each) => each.getAttribute("aria-label") === focused)?.focus();
  };
  new ResizeObserver(() => {
    const wide = Math.floor(drawing.clientWidth);
    if (!wide || wide === width) return;
    width = wide;
    again();
  }).observe(drawing);
  return () => width && again();
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

export function fitted(words, width) {
  const most = Math.max(Math.floor(width / 7.1), 3);
  return words.length <= most ? words : `${words.slice(0, most - 1)}…`;
}
