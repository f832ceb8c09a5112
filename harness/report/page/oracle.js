// The oracle ablation as a waterfall: the cost of each stage, in points of FRR.

import { drawn, percent, words } from "./dom.js";
import { canvas, figure, fitted, path, text, ticks } from "./figure.js";
import { data } from "./packs.js";

const HEIGHT = 230;

const number = (cell) => (cell === "" ? null : Number(cell));

const STEPS = data.oracle.map(([configuration, replaced, , frr, gained, low, high, reads]) =>
  ({ configuration, replaced, frr: Number(frr), gained: number(gained), low: number(low), high: number(high), reads }));

function ablations() {
  const groups = [];
  for (const step of STEPS) {
    if (step.replaced === "") groups.push([]);
    groups.at(-1).push(step);
  }
  return groups;
}

function drawOne(steps, width, from) {
  const svg = canvas(width, HEIGHT + 58, `Oracle ablation of ${steps[0].configuration}`);
  const left = 34;
  const y = (share) => 12 + (HEIGHT - 12) * (1 - (share - from) / (1 - from));
  for (const tick of ticks(from, 1, 5)) {
    svg.append(path(`M${left} ${y(tick)}H${width}`, { class: "grid" }), text(left - 6, y(tick) + 4, percent(tick, 0), { class: "tick", "text-anchor": "end" }));
  }
  const slot = (width - left) / steps.length;
  steps.forEach((step, i) => {
    const [x, wide] = [left + i * slot + 0.14 * slot, 0.72 * slot];
    const start = i ? steps[i - 1].frr : from;
    const kind = i === 0 ? "whole" : step.gained >= 0 ? "gain" : "loss";
    const [top, bottom] = [y(Math.max(start, step.frr)), y(Math.min(start, step.frr))];
    const said = i ? `${step.gained >= 0 ? "+" : "−"}${percent(Math.abs(step.gained))}` : `${percent(step.frr)} %`;
    const ends = step.low === null || i === 0 ? "" : `, 95 % ${percent(step.low)} to ${percent(step.high)}, ${step.reads}`;
    const name = i ? `+ true ${words(step.replaced)}` : "as run";
    const group = drawn("g", {}, drawn("title", {}, `${name}: FRR ${percent(step.frr)} %${i ? `, ${said} points${ends}` : ""}`),
      drawn("rect", { x, y: top, width: wide, height: Math.max(bottom - top, 1.5), class: kind }),
      text(x + wide / 2, top - 4, said, { class: "value", "text-anchor": "middle" }));
    if (i + 1 < steps.length) group.append(path(`M${x} ${y(step.frr)}H${x + slot + wide}`, { class: "whisker" }));
    const label = text(x + wide / 2, HEIGHT + 14, "", { class: "tick", "text-anchor": "middle" });
    (i ? ["true", ...words(step.replaced).split(" ")] : ["as run"]).forEach((word, k) =>
      label.append(drawn("tspan", { x: x + wide / 2, dy: k ? 13 : 0 }, fitted(word, slot + 8))));
    svg.append(group, label);
  });
  return svg;
}

export function drawOracle(place) {
  const lowest = Math.min(...STEPS.map((each) => each.frr));
  const from = Math.max(0, Math.floor(10 * lowest - 0.5) / 10);
  for (const steps of ablations()) {
    const part = document.createElement("div");
    place.append(part);
    figure(part, {
      title: steps[0].configuration, notes: ["FRR %; each step replaces one stage more by the truth"],
      draw: (width) => drawOne(steps, width, from),
      csv: () => [["step", "frr", "gained", "low", "high", "reads"],
        ...steps.map((each) => [each.configuration, each.frr, each.gained ?? "", each.low ?? "", each.high ?? "", each.reads])],
    });
  }
}
