// Values with their intervals, each in a row of its own, on one scale.

import { actionable, drawn } from "./dom.js";
import { canvas, fitted, gutter, hue, marker, path, text, ticks, withValue } from "./figure.js";

const ROW = 30;

export const scale = (from, to, left, right) => ({ from, to, x: (value) => left + (right - left) * (value - from) / (to - from) });

export function axis(svg, { x, from, to }, top, bottom, width, words) {
  for (const tick of ticks(from, to, width < 360 ? 4 : 8)) {
    svg.append(path(`M${x(tick)} ${top}V${bottom}`, { class: "grid" }),
      text(x(tick), bottom + 14, words(tick), { class: "tick", "text-anchor": tick === to ? "end" : "middle" }));
  }
}

export function whisker(group, { value, low, high, number }, { x }, y, radius) {
  group.append(drawn("rect", { class: "hit", x: x(low ?? value) - 6, y: y - 9, width: x(high ?? value) - x(low ?? value) + 12, height: 18 }));
  if (low !== null) group.append(path(`M${x(low)} ${y}H${x(high)}M${x(low)} ${y - 4}v8M${x(high)} ${y - 4}v8`, { class: `whisker ${hue(number)}` }));
  group.append(marker(x(value), y, number, radius));
  return group;
}

/**
 * Each row is {label, value, low, high, number, printed, ends, words}: `printed` and `ends` are the value and its interval as
 * text, `words` all of it for a screen reader. `action` makes the row a button, `dash` is a value that is drawn as a dashed tick.
 * A value of null has its text alone. `zero` marks 0 on the scale.
 */
export function drawIntervals(rows, width, { title, from, to, tick, aside = 118, zero = false }) {
  const narrow = width < 480;
  const [beside, above] = narrow ? [0, 18] : [aside, 0];
  const left = narrow ? 8 : gutter(rows.map((each) => each.label), width, 0.38);
  const height = rows.length * (ROW + above) + 24;
  const svg = canvas(width, height + 14, title);
  const place = scale(from, to, left, width - beside - 12);
  axis(svg, place, 4, height - 12, width, tick);
  if (zero) svg.append(path(`M${place.x(0)} 4V${height - 12}`, { class: "baseline" }));
  rows.forEach((each, i) => {
    const y = i * (ROW + above) + above + ROW / 2 + 2;
    const group = each.action ? actionable(drawn("g", { class: "row" }), each.words, each.action)
      : drawn("g", { class: "row", role: "img", "aria-label": each.words }, drawn("title", {}, each.words));
    group.append(drawn("rect", { class: "hit", x: 0, y: y - ROW / 2 - above, width, height: ROW + above }));
    if (narrow) group.append(text(4, y - ROW / 2 - 1, withValue(each.label, `${each.printed}${each.ends && ` (${each.ends})`}`, width), { class: "label" }));
    else {
      group.append(text(left - 12, y + 4, fitted(each.label, left - 12), { class: "label", "text-anchor": "end" }),
        text(width - beside + 8, y + 4, each.printed, { class: "value" }),
        text(width, y + 4, each.ends, { class: "tick", "text-anchor": "end" }));
    }
    if (each.dash !== undefined) group.append(path(`M${place.x(each.dash.value)} ${y - 8}v16`, { class: "baseline" }, drawn("title", {}, each.dash.words)));
    svg.append(each.value === null ? group : whisker(group, each, place, y, 5.5));
  });
  return svg;
}
