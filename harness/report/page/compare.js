// The page of `vfoa compare`: rates ranked, differences, and tables.

import { element, percent, sayDrawn } from "./dom.js";
import { figure } from "./figure.js";
import { drawIntervals } from "./intervals.js";
import { data } from "./packs.js";
import { fillTables } from "./tables.js";

const points = (share) => `${share > 0 ? "+" : share < 0 ? "−" : ""}${percent(Math.abs(share), 0)}`;
const csvShare = (share) => share?.toFixed(6) ?? "";
const asCsv = (name, rows) => [["configuration", "n", name, "low", "high"],
  ...rows.map((each) => [each.label, each.n, ...[each.value, each.low, each.high].map(csvShare)])];

function drawRanking(place) {
  const rows = data.ranking.map((each) => ({ ...each, printed: `${percent(each.value)} %`,
    words: `${each.label}: FRR ${percent(each.value)} %, 95 % ${each.ends}, n ${each.n}` }));
  const from = Math.max(0, Math.floor(10 * Math.min(...rows.map((each) => each.low ?? each.value)) - 0.3) / 10);
  figure(place, {
    title: "Focus recognition rate", notes: ["%, 95 % interval, the best first; a shape and colour is a configuration"],
    draw: (width) => drawIntervals(rows, width, { title: "Focus recognition rate, the best first", from, to: 1, tick: (share) => percent(share, 0) }),
    csv: () => asCsv("frr", rows),
  });
}

function drawDifferences(place) {
  const rows = data.differences.map((each) => ({ ...each, words: `${each.label}: ${each.printed} ${each.ends}; ${each.words}`, label: `${each.is_significant ? "✱ " : ""}${each.label}` }));
  const widest = Math.max(0.04, ...rows.flatMap((each) => [each.value, each.low, each.high].map((share) => Math.abs(share ?? 0))));
  const end = Math.ceil(50 * widest) / 50;
  figure(place, {
    title: "Differences on the same frames", notes: ["points of FRR, 95 % interval, corrected for all pairs; ✱: significant"],
    draw: (width) => drawIntervals(rows, width, { title: "Differences of the focus recognition rate", from: -end, to: end, tick: points, aside: 172, zero: true }),
    csv: () => asCsv("difference", data.differences),
  });
}

for (const [name, draw] of [["ranking", drawRanking], ["differences", drawDifferences]]) {
  const place = document.getElementById(`draw-${name}`);
  if (data[name].length) draw(place);
  else place.append(element("p", {}, "Nothing to compare."));
}
fillTables();
sayDrawn();
