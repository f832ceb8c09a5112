// A run's tracks and rows from its data, which harness/report/page/data.py describes.

import { data, once, packed, packedJson } from "./packs.js";

export const WRONG_FROM = 2; // the states before it are "correct" and "unscored"
export const UNKNOWN = 255;

function expanded(runs, length) {
  const values = new Int16Array(length);
  let at = 0;
  for (let i = 0; i < runs.length; i += 2) {
    values.fill(runs[i], at, at + runs[i + 1]);
    at += runs[i + 1];
  }
  return values;
}

// Numbers by their steps, as texts: time stamps have more digits than a number of JavaScript.
function summed([first, ...runs]) {
  let number = BigInt(first);
  const numbers = [first];
  for (let i = 0; i < runs.length; i += 2) {
    const step = BigInt(runs[i]);
    for (let k = 0; k < runs[i + 1]; k += 1) numbers.push(String((number += step)));
  }
  return numbers;
}

// A clip's tracks, one for each subject. Each has lanes, one for each configuration; `values` of a lane are there when
// `withValues` has been waited for: by number of the target's name, {total, gaze, head}.
export const clipTracks = (number) => once(`tracks ${number}`, async () => {
  const { tracks, colours } = await packedJson(`clip-${number}`);
  return tracks.map((track) => {
    const frames = summed(track.frames);
    const lanes = track.configurations.map((each) => ({
      ...each,
      name: data.configurations[each.configuration].name,
      oracle: data.configurations[each.configuration].oracle,
      states: expanded(each.states, frames.length),
      predicted: expanded(each.predicted, frames.length),
      answers: expanded(each.answers, frames.length),
      confidence: expanded(each.confidence, frames.length),
      values: null,
    }));
    const hundredths = track.hundredths.length ? summed(track.hundredths) : null;
    const place = new Map(frames.map((frame, i) => [frame, i]));
    return { clip: number, subject: track.subject, frames, hundredths, place, truth: expanded(track.truth, frames.length), lanes, colours };
  });
});

export const withValues = (number) => once(`values ${number}`, async () => {
  const [tracks, bytes] = [await clipTracks(number), await packed(`attention-${number}`)];
  if (!bytes) return tracks;
  const columns = tracks.flatMap((track) => track.lanes.flatMap((lane) => {
    lane.values = new Map();
    return lane.attended.map((name) => [lane, name, Math.ceil(track.frames.length / data.stride)]);
  }));
  let at = 0;
  const take = (count) => bytes.subarray(at, (at += count));
  for (const [lane, name, count] of columns) lane.values.set(name, { total: take(count) });
  for (const [lane, name, count] of columns) Object.assign(lane.values.get(name), { gaze: take(count), head: take(count) });
  return tracks;
});

// The place of a configuration in the experiment, which decides its colour and shape; a step of the oracle ablation
// or a seed has the place of its configuration.
const asked = data.scored.filter((each) => !each.oracle).map((each) => each.name);
export function numberOf(name) {
  const own = asked.indexOf(name);
  if (own >= 0) return own;
  return Math.max(asked.findLastIndex((each) => name.startsWith(`${each}+`) || name.startsWith(`${each}.seed`)), 0);
}

export const nameOf = (code) => (code < 0 ? null : data.names[code]);
// What is predicted; of a wrong frame the answer, which tells another object of the true name from the true one.
export const predictedName = (lane, i) => nameOf(isWrong(lane, i) ? lane.answers[i] : lane.predicted[i]) ?? "no prediction";
export const predictedInWords = (lane, i) =>
  predictedName(lane, i) + (lane.confidence[i] < 0 ? "" : ` (${lane.confidence[i]} %)`);
export const stateOf = (lane, i) => (lane.states[i] < 0 ? "no frame" : data.states[lane.states[i]]);
export const isWrong = (lane, i) => lane.states[i] >= WRONG_FROM;
export const isScored = (track) => track.lanes.some((lane) => lane.states.some((state) => state >= 0 && data.states[state] !== "unscored"));
// The place of the frame nearest to a place i of n of which the page has the attention.
export const placeOfValues = (i, n) => data.stride * Math.min(Math.round(i / data.stride), Math.ceil(n / data.stride) - 1);
export const valueAt = (cells, place) => {
  const cell = cells === null ? UNKNOWN : cells[place / data.stride];
  return cell === UNKNOWN ? null : cell / 250;
};

// A row of scores with names: see data.py.
export function row([clip, configuration, n, looks, correct, low, high, baseline, beats, errors]) {
  return {
    clip, configuration, n, looks, correct, low, high, baseline, beats, errors,
    frr: correct / n, name: data.scored[configuration].name, oracle: data.scored[configuration].oracle,
  };
}
export const overall = data.overall.map(row);
export const rowsByClip = () => once("rows by clip", async () => (await packedJson("rows")).map(row));
