// The selection: a clip, a configuration, a subject and a frame, all in the address, and the frames that N and P visit.

import { data } from "./packs.js";
import { clipTracks, isWrong, nameOf, predictedInWords, stateOf } from "./store.js";
import { say, tell } from "./dom.js";

export const shown = { track: null, lane: null, i: null, visits: null };
const listeners = [];

export const onSelection = (listener) => listeners.push(listener);

function changed(why = {}) {
  for (const listener of listeners) listener(why);
}

let turn = Promise.resolve();
// What is asked for while a clip is unpacked or searched waits for its turn, so that the last wish is what is shown.
function inTurn(action) {
  turn = turn.catch(() => {}).then(action);
  return turn;
}

// `wanted` may name a clip (number), a subject, a configuration (name) and a frame; the others stay the same. A function
// is asked for it in its turn, when what was asked for before is shown.
export const select = (wanted, why) => inTurn(() => show(typeof wanted === "function" ? wanted() : wanted, why));

async function show(wanted, why = {}) {
  const clip = wanted.clip ?? shown.track?.clip ?? 0;
  const tracks = await clipTracks(clip);
  const track = tracks.find((each) => each.subject === (wanted.subject ?? shown.track?.subject)) ?? tracks[0];
  if (!track) return;
  const name = wanted.config ?? shown.lane?.name;
  const lane = track.lanes.find((each) => each.name === name)
    ?? track.lanes.find((each) => each.name.startsWith(`${name}.seed`)) ?? track.lanes[0];
  const isThere = [undefined, track.subject].includes(wanted.subject) && (wanted.config === undefined || isOf(lane.name, wanted.config));
  const i = wanted.frame === undefined || !isThere ? null : track.place.get(wanted.frame) ?? null;
  if ("visits" in wanted) shown.visits = wanted.visits;
  Object.assign(shown, { track, lane, i });
  if (why.quiet !== true) writeAddress();
  changed(why);
  if (i !== null) say(frameInWords(track, lane, i));
}

export const close = () => inTurn(() => {
  shown.i = null;
  writeAddress();
  changed();
});

export const outcomeInWords = (state) =>
  ["correct", "unscored", "no frame"].includes(state) ? state : `wrong: ${state.replaceAll("_", " ")}`;

export function frameInWords(track, lane, i) {
  const truth = nameOf(track.truth[i]) ?? "not annotated";
  return `Frame ${track.frames[i]}, ${track.subject}, ${lane.name}: ${outcomeInWords(stateOf(lane, i))}. ` +
    `Truth ${truth}, predicted ${predictedInWords(lane, i)}.`;
}

// N and P visit the wrong frames of all configurations, clips and subjects, or what was selected in a figure: `visits` are
// {name, holds, config, clip}. `holds` says it of a track, a lane and a position, in this configuration and clip (-1: all).
// After the last one comes the first.

const isOf = (name, config) => name === config || name.startsWith(`${config}.seed`);

// The frames to visit in one configuration on one clip, subject by subject, as {track, lane, i}.
async function found(visits, clip, config) {
  const places = [];
  for (const track of await clipTracks(clip)) {
    const lane = track.lanes.find((each) => each.name === config);
    for (let i = 0; lane && i < track.frames.length; i += 1) {
      if (visits ? visits.holds(track, lane, i) : isWrong(lane, i)) places.push({ track, lane, i });
    }
  }
  return places;
}

// All pairs of a clip and a configuration to look in, configuration by configuration. A step of the oracle ablation is
// among them if it is shown or selected.
function pairs(visits, own) {
  const configs = data.configurations.filter(({ name, oracle }) => (visits?.config ? isOf(name, visits.config) : !oracle || name === own));
  const clips = visits && visits.clip >= 0 ? [visits.clip] : [...data.clips.keys()];
  return configs.flatMap(({ name }) => clips.map((clip) => [clip, name]));
}

const goTo = ({ track, lane, i }, more, why) =>
  show({ clip: track.clip, subject: track.subject, config: lane.name, frame: track.frames[i], ...more }, { centre: true, ...why });

export const step = (direction) => inTurn(async () => {
  const { track, lane, i, visits } = shown;
  if (!track) return;
  const all = pairs(visits, lane.name);
  const own = all.findIndex(([clip, config]) => clip === track.clip && config === lane.name);
  const start = own < 0 && direction < 0 ? all.length : own;
  const tracks = await clipTracks(track.clip);
  const from = i ?? (direction > 0 ? -1 : track.frames.length);
  const isAhead = (place) => direction * (tracks.indexOf(place.track) - tracks.indexOf(track) || place.i - from) > 0;
  for (let k = own < 0 ? 1 : 0; k <= all.length; k += 1) {
    const [clip, config] = all[(((start + direction * k) % all.length) + all.length) % all.length];
    const places = await found(visits, clip, config);
    const next = (k ? places : places.filter(isAhead)).at(direction > 0 ? 0 : -1);
    if (next) {
      await goTo(next);
      return;
    }
  }
  tell("There is no such frame.");
});

// Go to the first frame that `visits` holds, in this clip (or, without one, in the first clip that has any).
export const goToFirst = ({ clip = -1, config, visits }) => inTurn(async () => {
  const scoped = visits && { ...visits, clip, config };
  for (const [number, name] of pairs({ clip, config })) {
    const [first] = await found(scoped, number, name);
    if (first) {
      await goTo(first, { visits: scoped }, { jump: true });
      return;
    }
  }
  if (clip >= 0) await show({ clip, config, visits: null }, { jump: true });
  tell("There is no such frame.");
});

// The address: #clip=…&config=…&subject=…&frame=…

function placeShown() {
  const { track, lane, i } = shown;
  const parts = { clip: data.clips[track.clip].name, config: lane.name, subject: track.subject };
  return i === null ? parts : { ...parts, frame: track.frames[i] };
}

const writeAddress = () => history.replaceState(null, "", `#${new URLSearchParams(placeShown())}`);

// Returns whether the address names a place. Of one that is not on this page, what there is, is shown, but no frame.
export async function readAddress(why = {}) {
  const parts = new URLSearchParams(location.hash.slice(1));
  const asked = Object.fromEntries(["clip", "config", "subject", "frame"].flatMap((key) => (parts.has(key) ? [[key, parts.get(key)]] : [])));
  if (!Object.keys(asked).length) return false;
  const clip = "clip" in asked ? data.clips.findIndex(({ name }) => name === asked.clip) : 0;
  await inTurn(async () => {
    // This writes the address, too: what waited before it may have written another one.
    await show({ ...asked, clip: Math.max(clip, 0), frame: clip < 0 ? undefined : asked.frame }, { ...why, centre: true });
    const place = placeShown();
    const missing = Object.keys(asked).filter((key) => place[key] !== asked[key] && !(key === "config" && isOf(place.config, asked.config)));
    if (missing.length) tell(`The address names what is not on this page: ${missing.map((key) => `${key} ${asked[key]}`).join(", ")}.`);
  });
  return true;
}
