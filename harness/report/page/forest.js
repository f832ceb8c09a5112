// Rates with their intervals: every configuration over all clips, then clip by clip.

import { actionable, button, choice, drawn, element, percent } from "./dom.js";
import { canvas, figure, fitted, gutter, legendOf, text } from "./figure.js";
import { axis, drawIntervals, scale, whisker } from "./intervals.js";
import { goToFirst } from "./selection.js";
import { data } from "./packs.js";
import { numberOf, overall, rowsByClip } from "./store.js";

const PAGE = 8;
const SHORT = 12; // intervals on one axis of a print, so that its parts fill each sheet
const plain = (rows) => rows.filter((each) => !each.oracle);
const ends = (each) => (each.low === null ? "no interval" : `95 % ${percent(each.low, 0)}–${percent(each.high, 0)}`);
const inWords = (each) => `${each.name}${each.clip < 0 ? "" : ` on ${data.clips[each.clip].name}`}: FRR ${percent(each.frr)} %, ` +
  `${ends(each)}, n ${each.n}, best baseline ${percent(each.baseline)} %`;
const whole = (share) => percent(share, 0);
const placed = (each) => ({ ...each, value: each.frr, number: numberOf(each.name) });

function lowest(rows) {
  const least = Math.min(...rows.map((each) => Math.min(each.low ?? 1, each.frr, each.baseline)));
  return Math.max(0, Math.floor(10 * least - 0.3) / 10);
}

const drawOverall = (rows, width) => drawIntervals(rows.map((each) => ({
  ...placed(each), label: each.name, printed: `${percent(each.frr)} %`,
  ends: each.low === null ? "" : `${percent(each.low, 0)}–${percent(each.high, 0)}`,
  dash: { value: each.baseline, words: `best baseline ${percent(each.baseline)} %` },
  words: `${inWords(each)}. Show its wrong frames.`, action: () => goToFirst({ config: each.name, visits: null }),
})), width, { title: "Focus recognition rate of each configuration over all clips", from: lowest(rows), to: 1, tick: whole });

const ORDERS = {
  run: ["as run", null],
  name: ["name", (a, b) => (a.name < b.name ? -1 : 1)],
  low: ["lowest FRR first", (a, b) => a.lowest - b.lowest],
  spread: ["largest difference first", (a, b) => b.spread - a.spread],
};

function drawByClip(groups, width, { names, from }) {
  const narrow = width < 480;
  const left = narrow ? 8 : gutter(names, width, 0.34);
  const heights = groups.map((each) => 14 * each.rows.length + 14 + (narrow ? 16 : 0));
  const height = heights.reduce((sum, each) => sum + each, 0) + 8;
  const svg = canvas(width, height + 20, "Focus recognition rate by clip");
  const place = scale(from, 1, left, width - 14);
  axis(svg, place, 0, height, width, whole);
  let top = 0;
  groups.forEach((each, i) => {
    if (i % 2 === 0) svg.prepend(drawn("rect", { class: "band", x: 0, y: top, width, height: heights[i] }));
    const below = top + (narrow ? 16 : 0);
    svg.append(narrow ? text(4, top + 15, fitted(each.name, width - 4), { class: "label" })
      : text(left - 12, top + heights[i] / 2 + 4, fitted(each.name, left - 12), { class: "label", "text-anchor": "end" }));
    each.rows.forEach((one, k) => {
      const group = actionable(drawn("g", { class: "row" }), `${inWords(one)}. Show its wrong frames.`,
        () => goToFirst({ clip: one.clip, config: one.name, visits: null }));
      svg.append(whisker(group, placed(one), place, below + 14 * k + 14, 4));
    });
    top += heights[i];
  });
  return svg;
}

const csvShare = (share) => share?.toFixed(6) ?? "";
const asCsv = (rows) => [["clip", "configuration", "n", "looks", "frr", "low", "high", "baseline"],
  ...rows.map((each) => [each.clip < 0 ? "(all)" : data.clips[each.clip].name, each.name, each.n, each.looks,
    ...[each.frr, each.low, each.high, each.baseline].map(csvShare)])];

export async function drawForest(place) {
  const rows = plain(overall);
  if (!rows.length) {
    place.append(element("p", {}, "No annotated frames."));
    return;
  }
  const [first, second] = [element("div"), element("div")];
  place.append(first, second);
  figure(first, {
    title: "Over all clips", notes: ["FRR %, 95 % interval; dashes: the best baseline"],
    draw: (width) => drawOverall(rows, width), csv: () => asCsv(rows),
  });
  const byClip = plain(await rowsByClip());
  const groups = data.clips.map(({ name }, clip) => ({ name, rows: byClip.filter((each) => each.clip === clip) }))
    .filter((each) => each.rows.length);
  for (const each of groups) {
    const rates = each.rows.map((one) => one.frr);
    Object.assign(each, { lowest: Math.min(...rates), spread: Math.max(...rates) - Math.min(...rates) });
  }
  if (groups.length < 2) return;
  let [order, filter, at] = ["run", "", 0];
  const chosen = () => {
    const found = groups.filter((each) => each.name.toLowerCase().includes(filter));
    return ORDERS[order][1] ? found.sort(ORDERS[order][1]) : found;
  };
  const same = { names: groups.map((each) => each.name), from: lowest(byClip) }; // on every page
  const drawFrom = (first, number, width) => drawByClip(chosen().slice(first, first + number), width, same);
  const turn = (by) => {
    at = Math.min(Math.max(at + by, 0), Math.max(Math.ceil(chosen().length / PAGE) - 1, 0));
    const [from, all] = [at * PAGE, chosen().length];
    where.textContent = all ? `${from + 1} to ${Math.min(from + PAGE, all)} of ${all}` : "no such clip";
    again();
  };
  const search = element("input", { type: "search", placeholder: "filter", "aria-label": "Show clips whose name has" });
  search.addEventListener("input", () => { filter = search.value.toLowerCase(); at = 0; turn(0); });
  const where = element("span", { class: "small" });
  const [back, next] = [button("‹", () => turn(-1), { "aria-label": "Clips before" }), button("›", () => turn(1), { "aria-label": "Next clips" })];
  const many = groups.length > PAGE ? [search, element("span", { class: "pager" }, back, where, next)] : [];
  const again = figure(second, {
    title: "By clip", notes: ["FRR %, 95 % interval of each clip's looks"],
    controls: [choice("Order", Object.entries(ORDERS).map(([key, [words]]) => [key, words]), order, (key) => { order = key; at = 0; turn(0); }), ...many],
    legend: legendOf(rows.map(({ name }) => ({ name, number: numberOf(name) }))),
    draw: (width) => drawFrom(at * PAGE, PAGE, width),
    all: (width, isPrint = false) => {
      const most = isPrint ? Math.max(1, Math.floor(SHORT / rows.length)) : PAGE;
      return Array.from({ length: Math.ceil(chosen().length / most) }, (_, part) => drawFrom(part * most, most, width));
    },
    csv: () => asCsv(byClip),
  });
  turn(0);
}
