// The error types of wrong frames: a stacked bar for each configuration.

import { actionable, choice, drawn, element, percent, words } from "./dom.js";
import { canvas, figure, fitted, gutter, path, text, ticks, withValue } from "./figure.js";
import { goToFirst } from "./selection.js";
import { data } from "./packs.js";
import { overall, rowsByClip, stateOf } from "./store.js";

const ROW = 34;
const filled = (colour) => `--part: var(--${colour})`;

// `bars` are {name, total, said, parts: [{colour, value, mark, label, action}]}; totals and values are %, and a colour is
// a name of the style sheet's.
function stacked(bars, width) {
  const narrow = width < 480;
  const left = narrow ? 6 : gutter(bars.map((each) => each.name), width, 0.34);
  const above = narrow ? 18 : 0;
  const right = width - (narrow ? 6 : 92);
  const bottom = bars.length * (ROW + above) + 4;
  const svg = canvas(width, bottom + 22, "Error types of each configuration");
  const most = Math.max(5, ...bars.map((each) => each.total));
  const x = (value) => left + (right - left) * value / most;
  for (const tick of ticks(0, most, narrow ? 4 : 8)) {
    svg.append(path(`M${x(tick)} 0V${bottom}`, { class: "grid" }),
      text(x(tick), bottom + 14, `${tick}${tick ? " %" : ""}`, { class: "tick", "text-anchor": x(tick) > right - 14 ? "end" : "middle" }));
  }
  bars.forEach((bar, i) => {
    const y = i * (ROW + above) + above + 5;
    svg.append(narrow ? text(left, y - 5, withValue(bar.name, bar.said, width - left), { class: "label" })
      : text(left - 12, y + 17, fitted(bar.name, left - 12), { class: "label", "text-anchor": "end" }));
    if (!narrow) svg.append(text(x(bar.total) + 8, y + 17, bar.said, { class: "value" }));
    let start = 0;
    for (const part of bar.parts) {
      const wide = x(start + part.value) - x(start);
      const group = drawn("g", { class: "part" }, drawn("rect", { x: x(start), y, width: Math.max(wide, 0.5), height: ROW - 10, style: filled(part.colour) }));
      if (wide > 9 * part.mark.length + 4) group.append(text(x(start) + wide / 2, y + 17, part.mark, { class: "mark", "text-anchor": "middle" }));
      svg.append(actionable(group, part.label, part.action));
      start += part.value;
    }
  });
  return svg;
}

const key = (parts) => element("ul", { class: "legend" }, ...parts.map(([colour, mark, name, meaning]) =>
  element("li", { title: meaning }, element("span", { class: "swatch", style: filled(colour), "aria-hidden": "true" }, mark), name)));

export async function drawErrors(place) {
  const types = Object.keys(data.error_types);
  const rows = [...overall, ...await rowsByClip()].filter((each) => !each.oracle);
  if (!rows.length) return;
  let clip = overall[0].clip;
  const chosen = () => rows.filter((each) => each.clip === clip);
  const seen = types.filter((_, k) => rows.some((each) => each.errors[k]));
  const bar = (each) => ({
    name: each.name, total: 100 * (each.n - each.correct) / each.n, said: `${percent(1 - each.frr)} %`,
    parts: types.map((type, k) => ({
      colour: `error-${type}`, value: 100 * each.errors[k] / each.n, mark: data.letters[type],
      label: `${each.name}: ${each.errors[k]} of ${each.n} frames ${words(type)} (${data.error_types[type]}). Go to the first.`,
      action: () => goToFirst({ clip: each.clip, config: each.name, visits: { name: words(type), holds: (_, lane, i) => stateOf(lane, i) === type } }),
    })).filter((part) => part.value),
  });
  const clips = [...new Set(rows.map((each) => each.clip))];
  const again = figure(place, {
    title: "Why frames are wrong", notes: ["share of the scored frames, %; point at a part for its meaning, click to see its frames"],
    controls: clips.length > 1 ? [choice("Clip", clips.map((each) => [each, each < 0 ? "(all)" : data.clips[each].name]), clip, (value) => { clip = Number(value); again(); })] : [],
    legend: key(seen.map((type) => [`error-${type}`, data.letters[type], words(type), data.error_types[type]])),
    draw: (width) => stacked(chosen().map(bar), width),
    csv: () => [["clip", "configuration", "n", "wrong", ...types], ...rows.map((each) =>
      [each.clip < 0 ? "(all)" : data.clips[each.clip].name, each.name, each.n, each.n - each.correct, ...each.errors])],
  });
}
