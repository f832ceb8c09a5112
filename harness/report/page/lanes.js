// The lanes of a timeline, one above the other; each lane draws itself on a pen between two positions of frames.

import { data } from "./packs.js";
import { nameOf, valueAt, WRONG_FROM } from "./store.js";
import { DASHES, ticks } from "./figure.js";

// `view` is {from, to, left, width}: positions of frames, and their range in pixels.
export const toX = ({ from, to, left, width }, i) => left + width * (i - from) / (to - from);
export const toFrame = ({ from, to, left, width }, x) => from + (to - from) * (x - left) / width;

export function axisLane(track, rate) {
  return {
    height: rate ? 30 : 18,
    draw(pen, view, top, colours) {
      const first = track.frames[0];
      const places = ticks(view.from, view.to, Math.max(2, view.width / 90)).map(Math.round);
      for (const i of new Set(places)) {
        if (i < 0 || i >= track.frames.length || i < view.from) continue;
        const x = toX(view, i + 0.5);
        pen.line([[x, top + 1], [x, top + 5]], colours.of("soft"));
        const align = x < view.left + 16 ? "left" : x > view.left + view.width - 16 ? "right" : "center";
        pen.text(x, top + 15, String(track.frames[i]), colours.of("soft"), { align, size: 11 });
        if (rate) pen.text(x, top + 27, `${((track.frames[i] - first) / rate).toFixed(1)} s`, colours.of("soft"), { align, size: 10 });
      }
    },
    label: "Frame",
  };
}

function spans(values, from, to, visit) {
  let start = from;
  for (let i = from + 1; i <= to; i += 1) {
    if (i === to || values[i] !== values[start]) {
      visit(start, i, values[start]);
      start = i;
    }
  }
}

const bounds = (view, count) => [Math.max(0, Math.floor(view.from)), Math.min(count, Math.ceil(view.to))];

export function truthLane(track) {
  return {
    height: 20, label: "Truth",
    draw(pen, view, top, colours) {
      spans(track.truth, ...bounds(view, track.frames.length), (start, end, code) => {
        if (code < 0) return;
        const [x, wide] = [toX(view, start), toX(view, end) - toX(view, start)];
        pen.rect(x, top, Math.max(wide - 0.6, 0.4), 18, colours.shade(track.colours[code] ?? "rgb(150 150 150)"), 0.55);
        const words = nameOf(code);
        const seen = Math.max(x, view.left); // a look may begin off-screen
        if (pen.measure(words, 11) < x + wide - seen - 6) pen.text(seen + 4, top + 13, words, colours.of("ink"), { size: 11 });
      });
    },
  };
}

const colourOf = (state) => ({ correct: "right", unscored: "unscored" })[data.states[state]] ?? `error-${data.states[state]}`;

export function stripLane(lane) {
  return {
    height: 24, label: lane.name, lane,
    draw(pen, view, top, colours) {
      const [first, last] = bounds(view, lane.states.length);
      const fill = (state) => colours.of(colourOf(state));
      const cell = view.width / (view.to - view.from);
      if (cell < 1.5) {
        crowded(pen, view, top, lane, fill);
        return;
      }
      spans(lane.states, first, last, (start, end, state) => {
        if (state < 0) return;
        if (cell < 5) pen.rect(toX(view, start), top, toX(view, end) - toX(view, start), 20, fill(state));
        else for (let i = start; i < end; i += 1) pen.rect(toX(view, i), top, cell - 1, 20, fill(state));
        if (cell < 10) return;
        const letter = data.letters[data.states[state]];
        for (let i = start; i < end && letter; i += 1) {
          pen.text(toX(view, i + 0.5) - 0.5, top + 14, letter, colours.of(state < WRONG_FROM ? "ink" : "on-part"), { align: "center", size: 11, weight: 700 });
        }
      });
    },
  };
}

// More frames than pixels: in each column, the share of wrong frames as a height, in the colour of their commonest type.
function crowded(pen, view, top, lane, fill) {
  const columns = Math.floor(view.width);
  const colours = data.states.map((_, state) => fill(state));
  const counts = new Uint32Array(data.states.length);
  const grounds = [];
  for (let x = 0; x < columns; x += 1) {
    const [start, end] = bounds({ from: toFrame(view, view.left + x), to: toFrame(view, view.left + x + 1) }, lane.states.length);
    counts.fill(0);
    let [all, wrong, worst] = [0, 0, WRONG_FROM];
    for (let i = start; i < end; i += 1) {
      const state = lane.states[i];
      if (state < 0) continue;
      all += 1;
      counts[state] += 1;
      if (state < WRONG_FROM) continue;
      wrong += 1;
      if (counts[state] > counts[worst]) worst = state;
    }
    if (!all) continue;
    const ground = colours[counts[0] + wrong ? 0 : 1];
    if (grounds.at(-1)?.colour === ground && grounds.at(-1).end === x) grounds.at(-1).end = x + 1;
    else grounds.push({ start: x, end: x + 1, colour: ground, wrong: [] });
    if (wrong) grounds.at(-1).wrong.push([x, 20 * wrong / all, colours[worst]]);
  }
  for (const { start, end, colour, wrong } of grounds) {
    pen.rect(view.left + start, top, end - start, 20, colour);
    for (const [x, high, worst] of wrong) pen.rect(view.left + x, top + 20 - high, 1.05, high, worst);
  }
}

export function rateLane(lanes) {
  return {
    height: 92, label: "FRR, %",
    draw(pen, view, top, colours) {
      const low = top + 80;
      const y = (share) => low - 74 * share;
      for (const share of [0, 0.5, 1]) {
        pen.line([[view.left, y(share)], [view.left + view.width, y(share)]], colours.of("line"));
        pen.text(view.left + 2, y(share) + (share === 1 ? 11 : -2), String(100 * share), colours.of("soft"), { size: 10 });
      }
      const bins = Math.max(1, Math.min(80, Math.round(view.width / 14), Math.floor((view.to - view.from) / 3)));
      for (const { lane, number } of lanes) {
        let points = [];
        const flush = () => {
          if (points.length > 1) pen.line(points, colours.of(`c${number % 8}`), 2, DASHES[Math.floor(number / 8) % DASHES.length]);
          else if (points.length) pen.rect(points[0][0] - 2, points[0][1] - 2, 4, 4, colours.of(`c${number % 8}`));
          points = [];
        };
        for (let b = 0; b < bins; b += 1) {
          const wide = (view.to - view.from) / bins;
          const [start, end] = bounds({ from: view.from + b * wide, to: view.from + (b + 1) * wide - 1e-9 }, lane.states.length);
          let [right, all] = [0, 0];
          for (let i = start; i < end; i += 1) {
            if (lane.states[i] === 0) right += 1;
            if (lane.states[i] === 0 || lane.states[i] >= WRONG_FROM) all += 1;
          }
          if (all) points.push([toX(view, view.from + (b + 0.5) * wide), y(right / all)]);
          else flush();
        }
        flush();
      }
    },
  };
}

export function attentionLane(track, lane, look) {
  return {
    height: 118, label: "Attention",
    draw(pen, view, top, colours) {
      const low = top + 106;
      const y = (value) => low - 100 * value;
      spans(track.truth, ...bounds(view, track.frames.length), (start, end, code) => {
        if (code >= 0) pen.rect(toX(view, start), top + 4, toX(view, end) - toX(view, start), 102, colours.shade(track.colours[code] ?? "rgb(150 150 150)"), 0.14);
      });
      for (const value of [0, 0.5, 1]) {
        pen.line([[view.left, y(value)], [view.left + view.width, y(value)]], colours.of("line"));
        pen.text(view.left + 2, y(value) + (value === 1 ? 11 : -2), value.toFixed(1), colours.of("soft"), { size: 10 });
      }
      if (!lane.values) return;
      const stride = Math.max(data.stride, Math.floor((view.to - view.from) / view.width));
      const [first, last] = bounds(view, track.frames.length);
      for (const [name, { total }] of lane.values) {
        const { colour, dash } = look(name);
        let points = [];
        const flush = () => {
          if (points.length === 1) points.push([points[0][0] + Math.max(1, view.width / (view.to - view.from) / 2), points[0][1]]);
          if (points.length) pen.line(points, colours.shade(colour), 1.8, dash);
          points = [];
        };
        for (let start = first - first % stride; start < last; start += stride) {
          let [sum, all] = [0, 0];
          for (let i = start; i < Math.min(start + stride, last); i += data.stride) {
            const value = valueAt(total, i);
            if (value !== null) [sum, all] = [sum + value, all + 1];
          }
          if (all) points.push([toX(view, Math.min(start + stride / 2, last)), y(sum / all)]);
          else flush();
        }
        flush();
      }
    },
  };
}

export function pictureLane(track, pictures, ready) {
  const images = new Map();
  const imageOf = (frame) => {
    if (!images.has(frame)) {
      const image = new Image();
      image.onload = ready;
      image.src = pictures[frame];
      images.set(frame, image);
    }
    return images.get(frame);
  };
  return {
    height: 74, label: "Wrong frames",
    draw(pen, view, top, colours) {
      const slots = Math.max(1, Math.floor(view.width / 120));
      for (let s = 0; s < slots; s += 1) {
        const [start, end] = bounds({ from: toFrame(view, view.left + s * view.width / slots), to: toFrame(view, view.left + (s + 1) * view.width / slots) }, track.frames.length);
        let found = -1;
        for (let i = start; i < end && found < 0; i += 1) if (track.frames[i] in pictures) found = i;
        if (found < 0) continue;
        const image = imageOf(track.frames[found]);
        if (!image.complete || !image.naturalWidth) continue;
        const wide = Math.min(58 * image.naturalWidth / image.naturalHeight, view.width / slots - 6);
        const high = wide * image.naturalHeight / image.naturalWidth;
        const at = toX(view, found + 0.5);
        const x = Math.min(Math.max(at - wide / 2, view.left + s * view.width / slots), view.left + (s + 1) * view.width / slots - wide);
        pen.line([[at, top], [at, top + 6]], colours.of("soft"));
        pen.image(image, x, top + 6, wide, high);
        pen.text(x + 3, top + 6 + high - 4, String(track.frames[found]), "#fff", { size: 10, weight: 700 });
      }
    },
  };
}
