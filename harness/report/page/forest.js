// Rates with their intervals: every configuration over all clips, then clip by clip.

import { actionable, button, choice, drawn, element, percent } from "./dom.js";
import { canvas, figure, fitted, gutter, hue, legendOf, marker, path, text, ticks } from "./figure.js";
import { goToFirst } from "./selection.js";
import { data } from "./packs.js";
import { numberOf, overall, rowsByClip } from "./store.js";

const ROW = 30;
const PAGE = 8;
const plain = (rows) => rows.filter((each) => !each.oracle);
const ends = (each) => (each.low === null ? "no interval" : `95 % ${percent(each.low, 0)} to ${percent(each.high, 0)}`);
const inWords = (each) => `${each.name}${each.clip < 0 ? "" : ` on ${data.clips[each.clip].name}`}: FRR ${percent(each.frr)} %, ` +
  `${ends(each)}, n ${each.n}, best baseline ${percent(each.baseline)} %`;

function scale(rows, left, width) {
  const lowest = Math.min(...rows.map((each) => Math.min(each.low ?? 1, each.frr, each.baseline)));
  const from = Math.max(0, Math.floor(10 * lowest - 0.3) / 10);
  const x = (share) => left + (width - left) * (share - from) / (1 - from);
  return { x, from };
}

function axis(svg, { x, from }, top, bottom, width) {
  for (const tick of ticks(from, 1, width < 360 ? 4 : 8)) {
    svg.append(path(`M${x(tick)} ${top}V${bottom}`, { class: "grid" }),
      text(x(tick), bottom + 14, percent(tick, 0), { class: "tick", "text-anchor": tick === 1 ? "end" : "middle" }));
  }
}

function whisker(group, each, { x }, y, radius) {
  group.append(drawn("rect", { class: "hit", x: x(each.low ?? each.frr) - 6, y: y - 9, width: x(each.high ?? each.frr) - x(each.low ?? each.frr) + 12, height: 18 }));
  if (each.low !== null) group.append(path(`M${x(each.low)} ${y}H${x(each.high)}M${x(each.low)} ${y - 4}v8M${x(each.high)} ${y - 4}v8`, { class: `whisker ${hue(numberOf(each.name))}` }));
  group.append(marker(x(each.frr), y, numberOf(each.name), radius));
  return group;
}

function baselineTick(each, { x }, y) {
  return path(`M${x(each.baseline)} ${y - 8}v16`, { class: "baseline" }, drawn("title", {}, `best baseline ${percent(each.baseline)} %`));
}

function drawOverall(rows, width) {
  const beside = width < 480 ? 0 : 118;
  const left = width < 480 ? 8 : gutter(rows.map((each) => each.name), width, 0.34);
  const above = width < 480 ? 18 : 0;
  const height = rows.length * (ROW + above) + 24;
  const svg = canvas(width, height + 14, "Focus recognition rate of each configuration over all clips");
  const place = scale(rows, left, width - beside - 12);
  axis(svg, place, 4, height - 12, width);
  rows.forEach((each, i) => {
    const y = i * (ROW + above) + above + ROW / 2 + 2;
    const group = actionable(drawn("g", { class: "row" }), `${inWords(each)}. Show its wrong frames.`, () => goToFirst({ config: each.name, visits: null }));
    group.append(drawn("rect", { class: "hit", x: 0, y: y - ROW / 2 - above, width, height: ROW + above }));
    if (above) group.append(text(4, y - ROW / 2 - 1, `${each.name}  ${percent(each.frr)} % (${ends(each).slice(5)})`, { class: "label" }));
    else {
      group.append(text(left - 12, y + 4, fitted(each.name, left - 12), { class: "label", "text-anchor": "end" }),
        text(width - beside + 8, y + 4, `${percent(each.frr)} %`, { class: "value" }),
        text(width, y + 4, each.low === null ? "" : `${percent(each.low, 0)}–${percent(each.high, 0)}`, { class: "tick", "text-anchor": "end" }));
    }
    group.append(baselineTick(each, place, y));
    svg.append(whisker(group, each, place, y, 5.5));
  });
  return svg;
}

const ORDERS = {
  run: ["as run", null],
  name: ["name", (a, b) => (a.name < b.name ? -1 : 1)],
  low: ["lowest FRR first", (a, b) => a.lowest - b.lowest],
  spread: ["largest difference first", (a, b) => b.spread - a.spread],
};

function drawByClip(groups, width) {
  const narrow = width < 480;
  const left = narrow ? 8 : gutter(groups.map((each) => each.name), width, 0.34);
  const heights = groups.map((each) => 14 * each.rows.length + 14 + (narrow ? 16 : 0));
  const height = heights.reduce((sum, each) => sum + each, 0) + 8;
  const svg = canvas(width, height + 20, "Focus recognition rate by clip");
  const place = scale(groups.flatMap((each) => each.rows), left, width - 14);
  axis(svg, place, 0, height, width);
  let top = 0;
  groups.forEach((each, i) => {
    if (i % 2 === 0) svg.prepend(drawn("rect", { class: "band", x: 0, y: top, width, height: heights[i] }));
    const below = top + (narrow ? 16 : 0);
    svg.append(narrow ? text(4, top + 15, each.name, { class: "label" })
      : text(left - 12, top + heights[i] / 2 + 4, fitted(each.name, left - 12), { class: "label", "text-anchor": "end" }));
    each.rows.forEach((one, k) => {
      const group = actionable(drawn("g", { class: "row" }), `${inWords(one)}. Show its wrong frames.`,
        () => goToFirst({ clip: one.clip, config: one.name, visits: null }));
      svg.append(whisker(group, one, place, below + 14 * k + 14, 4));
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
    draw: (width) => drawByClip(chosen().slice(at * PAGE, (at + 1) * PAGE), width), csv: () => asCsv(byClip),
  });
  turn(0);
}
