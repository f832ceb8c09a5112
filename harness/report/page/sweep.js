// The page of a sweep: rates by two factors as heatmaps with numeric axes, and its tables.

import { drawn, percent } from "./dom.js";
import { canvas, figure, fitted, text } from "./figure.js";
import { data } from "./packs.js";
import { fillTables } from "./tables.js";

const { sweep } = data;

// From the lowest to the highest rate: dark blue to yellow, told apart in grey, too.
const STOPS = [[0, 34, 78], [66, 78, 108], [124, 123, 120], [187, 174, 108], [254, 232, 56]];
function colour(share) {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
  const [i, part] = [Math.min(Math.floor(at), STOPS.length - 2), at - Math.min(Math.floor(at), STOPS.length - 2)];
  return `rgb(${STOPS[i].map((each, k) => Math.round(each + part * (STOPS[i + 1][k] - each))).join(" ")})`;
}

// Borders of cells between two ends: half way between numbers, evenly spaced for words.
function borders(values, from, to) {
  const middles = values.slice(1).map((each, i) => (each + values[i]) / 2);
  const all = values.length < 2 ? [0, 1] : [2 * values[0] - middles[0], ...middles, 2 * values.at(-1) - middles.at(-1)];
  return all.map((each) => from + (to - from) * (each - all[0]) / (all.at(-1) - all[0]));
}

function heatmap(rates, title, width) {
  const { rows, columns, numbers } = sweep;
  const left = 46;
  const wide = width - left - 6;
  const gap = numbers && numbers < columns.length ? 14 : 0;
  const split = left + (gap ? wide * numbers / columns.length : numbers ? wide : 0);
  const x = [...(numbers ? borders(columns.slice(0, numbers).map(Number), left, split - gap / 2) : [])];
  const others = columns.length - numbers;
  const words = others ? borders([...Array(others).keys()], split + gap / 2, left + wide) : [];
  const height = 34 * rows.length;
  const y = borders(sweep.row_numbers ?? [...rows.keys()], height + 6, 6);
  const svg = canvas(width, height + 78, `${title}: focus recognition rate by ${sweep.per} and ${sweep.across}`);
  const flat = sweep.mean.flat().filter((each) => each !== null);
  const low = Math.min(...flat);
  columns.forEach((column, c) => {
    const [from, to] = c < numbers ? [x[c], x[c + 1]] : [words[c - numbers], words[c - numbers + 1]];
    rows.forEach((row, r) => {
      const rate = rates[r][c];
      if (rate === null) return;
      const group = drawn("g", {}, drawn("title", {}, `${sweep.per} ${row}, ${sweep.across} ${column}: FRR ${percent(rate)} %`),
        drawn("rect", { x: from, y: y[r + 1], width: Math.max(to - from - 0.6, 0.4), height: y[r] - y[r + 1] - 0.6, fill: colour((rate - low) / (1 - low)) }));
      if (to - from > 26 && y[r] - y[r + 1] > 12) {
        group.append(text((from + to) / 2, (y[r] + y[r + 1]) / 2 + 4, percent(rate, 0), { class: "tick", "text-anchor": "middle", style: `fill: ${(rate - low) / (1 - low) > 0.45 ? "#111" : "#fff"}` }));
      }
      svg.append(group);
    });
    const at = (from + to) / 2;
    svg.append(text(at + 4, height + 14, column, { class: "tick", "text-anchor": "end", transform: `rotate(-60 ${at + 4} ${height + 14})` }));
  });
  rows.forEach((row, r) => svg.append(text(left - 6, (y[r] + y[r + 1]) / 2 + 4, fitted(row, left), { class: "tick", "text-anchor": "end" })));
  svg.append(text(left, height + 72, sweep.across, { class: "tick" }));
  return svg;
}

for (const [key, title] of [["mean", "Mean over all other settings"], ["best", "Best of all other settings"]]) {
  const place = document.createElement("div");
  document.getElementById("draw-sweep").append(place);
  figure(place, {
    title, notes: [`focus recognition rate, %; rows: ${sweep.per}`],
    draw: (width) => heatmap(sweep[key], title, width),
    csv: () => [[sweep.per, ...sweep.columns], ...sweep.rows.map((row, r) => [row, ...sweep[key][r].map((each) => each ?? "")])],
  });
}
fillTables();
document.documentElement.dataset.ready = "yes";
