// The lanes of a timeline, one above the other: frame numbers, the truth, the outcomes of each configuration.

import { data } from "./packs.js";
import { nameOf, WRONG_FROM } from "./store.js";
import { ticks } from "./figure.js";

export const STRIP = 20; // pixels high

// `view` is {count, left, width}: the number of frames, and their range in pixels.
export const toX = ({ count, left, width }, i) => left + width * i / count;
export const isCrowded = ({ count, width }) => width < 1.5 * count;

// The frames at a pixel, [first, end): one, or several if there are more frames than pixels.
export function framesAt({ count, left, width }, x) {
  const [from, end] = [x, x + 1].map((each) => count * (each - left) / width);
  const first = Math.floor(from);
  return [first, Math.min(isCrowded({ count, width }) ? Math.ceil(end) : first + 1, count)];
}

// The numbers of the frames, and their times in seconds since the clip's first one, if the run has them.
export function axisLane(track) {
  return {
    height: track.hundredths ? 30 : 18, label: "Frame",
    draw(pen, view, top, colours) {
      const places = new Set(ticks(0, view.count, Math.max(2, view.width / 90)).map(Math.round));
      const [first, second] = [...places].map((i) => track.hundredths?.[i]);
      const digits = second - first < 10 ? 2 : 1;
      for (const i of places) {
        if (i >= view.count) continue;
        const x = toX(view, i + 0.5);
        pen.rect(x - 0.5, top + 1, 1, 4, colours.of("soft"));
        const align = x < view.left + 16 ? "left" : x > view.left + view.width - 16 ? "right" : "center";
        pen.text(x, top + 15, track.frames[i], colours.of("soft"), { align, size: 11 });
        if (track.hundredths) pen.text(x, top + 27, `${(track.hundredths[i] / 100).toFixed(digits)} s`, colours.of("soft"), { align, size: 10 });
      }
    },
  };
}

function spans(values, visit) {
  let start = 0;
  for (let i = 1; i <= values.length; i += 1) {
    if (i === values.length || values[i] !== values[start]) {
      if (values[start] >= 0) visit(start, i, values[start]);
      start = i;
    }
  }
}

export const truthLane = (track) => ({ height: STRIP, ...namesLane(track, "Truth", track.truth) });

// What a configuration answers, where no label says whether it is right.
export const answersLane = (track, lane) => ({ height: STRIP + 4, lane, ...namesLane(track, lane.name, lane.predicted) });

function namesLane(track, label, codes) {
  return {
    label,
    draw(pen, view, top, colours) {
      spans(codes, (start, end, code) => {
        const [x, wide] = [toX(view, start), toX(view, end) - toX(view, start)];
        pen.rect(x, top, Math.max(wide - 0.6, 0.4), STRIP - 2, colours.shade(track.colours[code] ?? "rgb(150 150 150)"), 0.55);
        const words = nameOf(code);
        if (pen.measure(words, 11) < wide - 6) pen.text(x + 4, top + 13, words, colours.of("ink"), { size: 11 });
      });
    },
  };
}

const colourOf = (state) => ({ correct: "right", unscored: "unscored" })[data.states[state]] ?? `error-${data.states[state]}`;

export function stripLane(lane) {
  return {
    height: STRIP + 4, label: lane.name, lane,
    draw(pen, view, top, colours) {
      const fill = data.states.map((_, state) => colours.of(colourOf(state)));
      const cell = view.width / view.count;
      if (isCrowded(view)) {
        crowded(pen, view, top, lane, fill);
        return;
      }
      spans(lane.states, (start, end, state) => {
        const letter = cell < 10 ? "" : data.letters[data.states[state]];
        if (cell < 5) pen.rect(toX(view, start), top, toX(view, end) - toX(view, start), STRIP, fill[state]);
        else for (let i = start; i < end; i += 1) pen.rect(toX(view, i), top, cell - 1, STRIP, fill[state]);
        for (let i = start; i < end && letter; i += 1) {
          pen.text(toX(view, i + 0.5) - 0.5, top + 14, letter, colours.of(state < WRONG_FROM ? "ink" : "on-part"), { align: "center", size: 11, weight: 700 });
        }
      });
    },
  };
}

// More frames than pixels: in each column, the share of wrong frames as a height, in the colour of their commonest type.
function crowded(pen, view, top, lane, fill) {
  const counts = new Uint32Array(fill.length);
  for (let x = 0; x < view.width; x += 1) {
    counts.fill(0);
    const [first, end] = framesAt(view, view.left + x);
    for (let i = first; i < end; i += 1) {
      if (lane.states[i] >= 0) counts[lane.states[i]] += 1;
    }
    const all = counts.reduce((sum, each) => sum + each, 0);
    if (!all) continue;
    const types = counts.subarray(WRONG_FROM);
    const wrong = types.reduce((sum, each) => sum + each, 0);
    pen.rect(view.left + x, top, 1.05, STRIP, fill[counts[0] + wrong ? 0 : 1]);
    if (wrong) pen.rect(view.left + x, top + STRIP * (1 - wrong / all), 1.05, STRIP * wrong / all, fill[WRONG_FROM + types.indexOf(Math.max(...types))]);
  }
}
