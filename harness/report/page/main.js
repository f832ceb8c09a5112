// Starts the page: the result first, then the sections below it when the rest has been read.

import { drawCalibration } from "./calibration.js";
import { drawConfusion } from "./confusion.js";
import { sayDrawn } from "./dom.js";
import { followFrames } from "./frame_box.js";
import { drawForest } from "./forest.js";
import { drawOracle } from "./oracle.js";
import { withRun } from "./recordings.js";
import { close, onSelection, readAddress, select, shown, step } from "./selection.js";
import { drawErrors } from "./stacked_bars.js";
import { data } from "./packs.js";
import { clipTracks, isWrong, nameOf, predictedName, stateOf } from "./store.js";
import { fillTables, tableOf } from "./tables.js";
import { drawTimeline } from "./timeline.js";

const place = (name) => document.getElementById(`draw-${name}`);

// The wrong frames of the shown subject, as a table whose rows link to them.
function wrongFrames(fold) {
  const fill = () => {
    if (!fold.open || !shown.track) return;
    const { track } = shown;
    const found = track.lanes.filter((lane) => !lane.oracle || lane === shown.lane).flatMap((lane) =>
      track.frames.flatMap((frame, i) => (isWrong(lane, i) ? [[lane, frame, i]] : [])));
    const clip = data.clips[track.clip].name;
    fold.replaceChildren(fold.firstElementChild, tableOf({
      title: `Wrong frames of ${track.subject} in ${clip}`, columns: ["Frame", "Configuration", "Truth", "Predicted", "Error type"], words: 5,
      rows: found.map(([lane, frame, i]) => [frame, lane.name, nameOf(track.truth[i]) ?? "", predictedName(lane, i), stateOf(lane, i).replaceAll("_", " ")]),
      links: { 0: (k) => `#${new URLSearchParams({ clip, config: found[k][0].name, subject: track.subject, frame: found[k][1] })}` },
    }));
  };
  let last = [];
  onSelection(() => {
    const now = [shown.track, shown.lane?.oracle ? shown.lane : null];
    if (now.some((each, k) => each !== last[k])) fill();
    last = now;
  });
  fold.addEventListener("toggle", fill);
}

function listen() {
  window.addEventListener("hashchange", () => readAddress({ jump: true }));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest("input:not([type=checkbox]), select, textarea")) return;
    const goals = { escape: close, n: () => step(1), p: () => step(-1) };
    const goal = shown.track && goals[event.key.toLowerCase()];
    if (goal) goal();
  });
}

async function start() {
  for (const line of document.querySelectorAll("#verdict p")) line.textContent = withRun(line.textContent);
  const isScored = data.overall.length > 0;
  if (isScored) drawForest(place("forest"));
  if (data.oracle.length) drawOracle(place("oracle"));
  if (data.calibration.length) drawCalibration(place("calibration"));
  if (isScored) await drawErrors(place("errors"));
  fillTables(withRun);
  if (!data.clips.some((each) => each.subjects.length)) {
    place("timeline").append("No person has a name or a label.");
    return;
  }
  drawTimeline(place("timeline"));
  followFrames();
  if (isScored) wrongFrames(document.getElementById("wrong-frames"));
  listen();
  if (!await readAddress({ jump: true })) {
    for (const clip of data.clips.keys()) {
      if ((await clipTracks(clip)).length) {
        await select({ clip }, { quiet: true });
        break;
      }
    }
  }
  if (isScored) await drawConfusion(place("confusion"));
  sayDrawn();
}

start();
