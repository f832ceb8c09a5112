// The selection: a clip, a configuration, a subject and a frame, all in the address, and the frames that N and P visit.

import { data } from "./packs.js";
import { clipTracks, isWrong, nameOf, stateOf } from "./store.js";
import { say } from "./dom.js";

export const shown = { track: null, lane: null, i: null, visits: null };
const listeners = [];

export const onSelection = (listener) => listeners.push(listener);

function changed(why = {}) {
  for (const listener of listeners) listener(why);
}

// `wanted` may name a clip (number), a subject, a configuration (name) and a frame; the others stay the same.
export async function select(wanted, why = {}) {
  const clip = wanted.clip ?? shown.track?.clip ?? 0;
  const tracks = await clipTracks(clip);
  const track = tracks.find((each) => each.subject === (wanted.subject ?? shown.track?.subject)) ?? tracks[0];
  if (!track) return;
  const name = wanted.config ?? shown.lane?.name;
  const lane = track.lanes.find((each) => each.name === name)
    ?? track.lanes.find((each) => each.name.startsWith(`${name}.seed`)) ?? track.lanes[0];
  const i = wanted.frame === undefined ? null : track.place.get(wanted.frame) ?? null;
  if ("visits" in wanted) shown.visits = wanted.visits;
  Object.assign(shown, { track, lane, i });
  if (why.quiet !== true) writeAddress();
  changed(why);
  if (i !== null) say(frameInWords(track, lane, i));
}

export function close() {
  shown.i = null;
  writeAddress();
  changed();
}

export const outcomeInWords = (state) =>
  ["correct", "unscored", "no frame"].includes(state) ? state : `wrong: ${state.replaceAll("_", " ")}`;

export function frameInWords(track, lane, i) {
  const truth = nameOf(track.truth[i]) ?? "not annotated";
  const predicted = nameOf(lane.predicted[i]) ?? "no prediction";
  return `Frame ${track.frames[i]}, ${track.subject}, ${lane.name}: ${outcomeInWords(stateOf(lane, i))}. ` +
    `Truth ${truth}, predicted ${predicted}.`;
}

// N and P visit wrong frames, or those selected in a figure; after the last one comes the first.
export function visited(lane, track) {
  const wanted = shown.visits;
  return (i) => (wanted ? wanted.holds(track, lane, i) : isWrong(lane, i));
}

export function step(direction) {
  const { track, lane, i } = shown;
  if (!track) return;
  const count = track.frames.length;
  const holds = visited(lane, track);
  const start = i ?? (direction > 0 ? -1 : count);
  for (let k = 1; k <= count; k += 1) {
    const next = (((start + direction * k) % count) + count) % count;
    if (holds(next)) {
      select({ frame: track.frames[next] }, { centre: true });
      return;
    }
  }
  say("There is no such frame here.");
}

// Go to the first frame that `visits` holds, in this clip (or, without one, in the first clip that has any).
export async function goToFirst({ clip, config, visits }) {
  const numbers = clip === undefined || clip < 0 ? data.clips.keys() : [clip];
  for (const number of numbers) {
    for (const track of await clipTracks(number)) {
      const lane = track.lanes.find((each) => each.name === config) ?? track.lanes.find((each) => each.name.startsWith(`${config}.seed`));
      const i = lane ? track.frames.findIndex((_, at) => (visits ? visits.holds(track, lane, at) : isWrong(lane, at))) : -1;
      if (i >= 0) {
        await select({ clip: number, subject: track.subject, config: lane.name, frame: track.frames[i], visits }, { jump: true, centre: true });
        return;
      }
    }
  }
  if (clip !== undefined && clip >= 0) await select({ clip, config, visits: null }, { jump: true });
  say("There is no such frame.");
}

// The address: #clip=…&config=…&subject=…&frame=…

function writeAddress() {
  const { track, lane, i } = shown;
  const parts = { clip: data.clips[track.clip].name, config: lane.name, subject: track.subject };
  if (i !== null) parts.frame = track.frames[i];
  history.replaceState(null, "", `#${new URLSearchParams(parts)}`);
}

export async function readAddress(why = {}) {
  const parts = new URLSearchParams(location.hash.slice(1));
  if (![...parts.keys()].length) return false;
  const clip = data.clips.findIndex((each) => each.name === parts.get("clip"));
  const wanted = { clip: Math.max(clip, 0) };
  for (const key of ["config", "subject"]) if (parts.has(key)) wanted[key] = parts.get(key);
  if (parts.has("frame")) wanted.frame = Number(parts.get("frame"));
  await select(wanted, { ...why, centre: true, quiet: true });
  return true;
}
