// Truth by answer as heatmaps, with the same rows and columns for all configurations.

import { actionable, choice, drawn, element } from "./dom.js";
import { canvas, figure, fitted, text } from "./figure.js";
import { goToFirst } from "./selection.js";
import { data } from "./packs.js";
import { clipTracks, nameOf } from "./store.js";

const LAST = ["none", "(nothing hit)", "no prediction"];

// Scored frames by lane's name: a map from "truth answer" to their number.
async function counted(clip) {
  const counts = new Map();
  for (const track of await clipTracks(clip)) {
    for (const lane of track.lanes) {
      if (lane.oracle) continue;
      if (!counts.has(lane.name)) counts.set(lane.name, new Map());
      const of = counts.get(lane.name);
      for (let i = 0; i < track.frames.length; i += 1) {
        if (lane.answers[i] < 0) continue;
        const key = `${track.truth[i]} ${lane.answers[i]}`;
        of.set(key, (of.get(key) ?? 0) + 1);
      }
    }
  }
  return counts;
}

function axes(counts) {
  const pairs = [...counts.values()].flatMap((of) => [...of.keys()].map((key) => key.split(" ").map(Number)));
  const byName = (a, b) => LAST.indexOf(nameOf(a)) - LAST.indexOf(nameOf(b)) || nameOf(a).localeCompare(nameOf(b), "en", { numeric: true });
  const truths = [...new Set(pairs.map(([truth]) => truth))].sort(byName);
  const others = [...new Set(pairs.map(([, answer]) => answer))].filter((each) => !truths.includes(each)).sort(byName);
  return { truths, answers: [...truths, ...others] };
}

function heatmap(clip, name, of, { truths, answers }, width) {
  const left = Math.min(6.9 * Math.max(...truths.map((each) => nameOf(each).length)) + 14, 0.32 * width);
  const last = Math.min(6.5 * nameOf(answers.at(-1)).length, 118); // its slanted label needs room on the right
  const cell = Math.max(Math.min((width - left) / answers.length, (width - left - 0.82 * last) / (answers.length - 0.5), 54), 14);
  const high = Math.min(cell, 26);
  const top = 8 + Math.min(6.5 * Math.max(...answers.map((each) => nameOf(each).length)), 112);
  const svg = canvas(Math.max(left + cell * answers.length, left + cell * (answers.length - 0.5) + 0.82 * last + 8, 40), top + high * truths.length + 4, `Confusion of ${name} on ${data.clips[clip].name}`);
  answers.forEach((answer, k) => {
    const [x, y] = [left + cell * k + cell / 2 + 4, top - 6];
    svg.append(text(x, y, fitted(nameOf(answer), 118), { class: "tick", transform: `rotate(-${cell > 50 ? 35 : 60} ${x} ${y})` }));
  });
  truths.forEach((truth, r) => {
    const total = answers.reduce((sum, answer) => sum + (of.get(`${truth} ${answer}`) ?? 0), 0);
    svg.append(text(left - 8, top + high * r + high / 2 + 4, fitted(nameOf(truth), left - 8), { class: "tick", "text-anchor": "end" }));
    answers.forEach((answer, k) => {
      const count = of.get(`${truth} ${answer}`) ?? 0;
      const [x, y] = [left + cell * k, top + high * r];
      const square = drawn("rect", { x: x + 0.5, y: y + 0.5, width: cell - 1, height: high - 1, class: "cell" });
      if (!count) {
        svg.append(square);
        return;
      }
      const share = count / total;
      const filled = drawn("rect", { x: x + 0.5, y: y + 0.5, width: cell - 1, height: high - 1, class: truth === answer ? "right" : "off", opacity: 0.15 + 0.85 * share });
      const group = drawn("g", { class: "row" }, square, filled);
      if (cell >= 7 * String(count).length + 4) group.append(text(x + cell / 2, y + high / 2 + 4, count, { class: `count${share > 0.55 ? " deep" : ""}`, "text-anchor": "middle" }));
      const said = `${name}: truth ${nameOf(truth)}, answer ${nameOf(answer)}: ${count} of ${total} frames. Go to the first.`;
      svg.append(actionable(group, said, () => goToFirst({
        clip, config: name,
        visits: { name: `${nameOf(truth)} answered as ${nameOf(answer)}`, holds: (track, lane, i) => track.truth[i] === truth && lane.answers[i] === answer },
      })));
    });
  });
  return svg;
}

export async function drawConfusion(place) {
  const maps = element("div", { class: "side" });
  let serial = 0;
  const show = async (clip) => {
    const mine = (serial += 1);
    const counts = await counted(clip);
    if (mine !== serial) return;
    maps.replaceChildren();
    if (![...counts.values()].some((of) => of.size)) maps.append(element("p", {}, "No scored frames."));
    else {
      const both = axes(counts);
      for (const [name, of] of counts) {
        const part = element("div");
        maps.append(part);
        figure(part, {
          title: name, draw: (width) => heatmap(clip, name, of, both, width),
          csv: () => [["truth", ...both.answers.map(nameOf)],
            ...both.truths.map((truth) => [nameOf(truth), ...both.answers.map((answer) => of.get(`${truth} ${answer}`) ?? 0)])],
        });
      }
    }
  };
  if (data.clips.length > 1) {
    place.append(element("div", { class: "controls" },
      choice("Clip", data.clips.map((each, i) => [i, each.name]), 0, (value) => show(Number(value)))));
  }
  place.append(maps);
  await show(0);
}
