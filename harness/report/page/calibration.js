// Calibration of probabilities: the share of right frames against their confidence.

import { drawn, percent } from "./dom.js";
import { canvas, figure, legendOf, marker, path, text, ticks } from "./figure.js";
import { data } from "./packs.js";
import { numberOf } from "./store.js";

function diagram(width) {
  const size = Math.min(width, 420);
  const svg = canvas(size, size, "Reliability diagram");
  const [left, bottom] = [40, size - 40];
  const [x, y] = [(share) => left + (size - left - 12) * share, (share) => bottom - (bottom - 10) * share];
  for (const tick of ticks(0, 1, 5)) {
    svg.append(path(`M${x(tick)} ${y(0)}V${y(1)}M${x(0)} ${y(tick)}H${x(1)}`, { class: "grid" }),
      text(x(tick), bottom + 15, percent(tick, 0), { class: "tick", "text-anchor": "middle" }),
      text(left - 6, y(tick) + 4, percent(tick, 0), { class: "tick", "text-anchor": "end" }));
  }
  svg.append(path(`M${x(0)} ${y(0)}L${x(1)} ${y(1)}`, { class: "baseline" }),
    text((x(0) + x(1)) / 2, size - 6, "confidence, %", { class: "tick", "text-anchor": "middle" }),
    text(12, y(0.5), "right, %", { class: "tick", "text-anchor": "middle", transform: `rotate(-90 12 ${y(0.5)})` }));
  const most = Math.max(...data.calibration.flatMap(({ bins }) => bins.map(([, , count]) => count)));
  for (const { configuration, bins } of data.calibration) {
    const number = numberOf(configuration);
    const points = bins.map(([confidence, accuracy]) => `${x(confidence)},${y(accuracy)}`).join(" ");
    svg.append(drawn("polyline", { points, class: `line c${number % 8}` }));
    for (const [confidence, accuracy, count] of bins) {
      const group = drawn("g", {}, marker(x(confidence), y(accuracy), number, 1.5 + 4.5 * Math.sqrt(count / most)));
      group.append(drawn("title", {}, `${configuration}: ${percent(accuracy)} % right at ${percent(confidence)} % confidence, ${count} frames`));
      svg.append(group);
    }
  }
  return svg;
}

export function drawCalibration(place) {
  figure(place, {
    title: "Calibration", notes: ["dashes: as sure as right; the area of a mark grows with its frames"],
    legend: legendOf(data.calibration.map(({ configuration, error }) =>
      ({ name: `${configuration} (ECE ${error.toFixed(3)})`, number: numberOf(configuration) }))),
    draw: diagram,
    csv: () => [["configuration", "confidence", "right", "frames"], ...data.calibration.flatMap(({ configuration, bins }) =>
      bins.map((each) => [configuration, ...each]))],
  });
}
