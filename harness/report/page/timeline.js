// The timeline of one subject on a canvas: frame numbers, the truth and the outcomes of each configuration; pointer and keys.

import { button, choice, element } from "./dom.js";
import { shortened } from "./figure.js";
import { answersLane, axisLane, framesAt, isCrowded, STRIP, stripLane, toX, truthLane } from "./timeline_lanes.js";
import { canvasPen, palette } from "./pens.js";
import { followInRecording, openRecording } from "./recordings.js";
import { frameInWords, onSelection, select, shown, step } from "./selection.js";
import { data } from "./packs.js";
import { isScored, isWrong } from "./store.js";

const view = { count: 1, left: 0, width: 1 };
const sheet = element("canvas", { tabindex: "0", role: "slider", id: "timeline" });
let [lanes, withOracles, scheduled, preview] = [[], false, false, null];
const followers = [];

// `listener` is called with {track, lane, i} under the pointer, and with null when it leaves.
export const onPreview = (listener) => followers.push(listener);

const strips = () => shown.track.lanes.filter((each) => withOracles || !each.oracle || each === shown.lane);

function arrange() {
  const { track } = shown;
  view.count = track.frames.length;
  const below = isScored(track) ? [truthLane(track), ...strips().map(stripLane)] : strips().map((lane) => answersLane(track, lane));
  lanes = [axisLane(track), ...below];
  redraw();
}

function redraw() {
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(() => {
    scheduled = false;
    if (!shown.track || !sheet.clientWidth) return;
    const height = place(sheet.clientWidth);
    const [pen, colours] = [canvasPen(sheet, sheet.clientWidth, height), palette()];
    for (const lane of lanes) drawLane(pen, lane, colours);
    drawCursor(pen, height, colours);
  });
}

function place(width) {
  const narrow = width < 560;
  view.left = narrow ? 0 : Math.min(170, 20 + 7 * Math.max(12, ...lanes.map((each) => each.label.length)));
  view.width = width - view.left;
  let top = 0;
  for (const lane of lanes) {
    lane.top = top + (narrow ? 15 : 0);
    top = lane.top + lane.height;
  }
  const rows = Object.fromEntries(lanes.filter((each) => each.lane).map((each) => [each.label, each.top + 10]));
  sheet.dataset.places = JSON.stringify({ first: shown.track.frames[0], ...view, rows });
  return top + 4;
}

function drawLane(pen, lane, colours) {
  const chosen = lane.lane === shown.lane;
  const at = view.left ? [view.left - 10, lane.top + Math.min(15, lane.height - 4)] : [2, lane.top - 3];
  const words = shortened(lane.label, Math.floor((view.left || view.width) / 6.6) - 2);
  pen.text(...at, `${chosen ? "▸ " : ""}${words}`, colours.of(chosen ? "ink" : "soft"), { align: view.left ? "right" : "left", weight: chosen ? 700 : 400 });
  lane.draw(pen, view, lane.top, colours);
}

function drawCursor(pen, height, colours) {
  const { lane, i } = preview ?? shown;
  if (i === null) return;
  const [x, wide] = [toX(view, i), Math.max(view.width / view.count, 1.5)];
  pen.frame(x - 0.5, 1, wide, height - 6, colours.of("focus"), 1.5);
  const strip = lanes.find((each) => each.lane === lane);
  if (strip) pen.frame(x - 1, strip.top - 2, wide + 1, STRIP + 3, colours.of("focus"), 3);
}

// Pointer

const REACH = 2; // pixels: as far from a wrong frame that is narrower than a pixel it is the one pointed at
function under(event) {
  const box = sheet.getBoundingClientRect();
  const [x, y] = [Math.floor(event.clientX - box.left), event.clientY - box.top];
  const [first] = framesAt(view, x);
  if (first < 0 || first >= view.count) return null;
  const lane = lanes.find((each) => each.lane && y >= each.top - 2 && y < each.top + each.height)?.lane ?? shown.lane;
  const near = [];
  const end = isCrowded(view) ? framesAt(view, x + REACH)[1] : 0;
  for (let i = Math.max(framesAt(view, x - REACH)[0], 0); i < end; i += 1) if (isWrong(lane, i)) near.push(i);
  near.sort((a, b) => Math.abs(a - first) - Math.abs(b - first));
  return { track: shown.track, lane, i: near[0] ?? first };
}

function showPreview(found) {
  if (preview?.i === found?.i && preview?.lane === found?.lane) return;
  preview = found;
  for (const follow of followers) follow(preview);
  redraw();
}

function listen() {
  sheet.addEventListener("pointermove", (event) => { if (event.pointerType === "mouse") showPreview(under(event)); });
  sheet.addEventListener("pointerleave", () => showPreview(null));
  sheet.addEventListener("click", (event) => {
    const found = under(event);
    if (!found) return;
    const { track, lane, i } = found;
    select({ clip: track.clip, subject: track.subject, config: lane.name, frame: track.frames[i] });
    openRecording(track, lane, i);
  });
  sheet.addEventListener("keydown", onKey);
  oracles.addEventListener("change", () => { withOracles = oracles.checked; fillLists(); arrange(); });
}

function onKey(event) {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const goto = (next) => select(() => {
    const { frames } = shown.track;
    return { frame: frames[Math.min(Math.max(next(shown.i), 0), frames.length - 1)] };
  });
  const other = (by) => select(() => {
    const [{ track, lane, i }, all] = [shown, strips()];
    return { config: all[(all.indexOf(lane) + by + all.length) % all.length].name, frame: track.frames[i ?? 0] };
  });
  const goals = {
    ArrowRight: () => goto((i) => (i ?? -1) + 1), ArrowLeft: () => goto((i) => i - 1), ArrowDown: () => other(1), ArrowUp: () => other(-1),
    PageDown: () => goto((i) => i + 25), PageUp: () => goto((i) => i - 25), Home: () => goto(() => 0), End: () => goto(() => Infinity),
    Enter: () => shown.i !== null && openRecording(shown.track, shown.lane, shown.i),
  };
  const goal = goals[event.key];
  if (!goal) return;
  event.preventDefault();
  goal();
}

// Lists and buttons above it

// The same elements all the time: one that is replaced between press and release is not clicked.
const frameShown = () => shown.track.frames[shown.i];
const clips = choice("Clip", data.clips.map((each, i) => [i, each.name]), 0, (value) => select({ clip: Number(value), visits: null }));
const subjects = choice("Subject", [], null, (value) => select({ subject: value }));
const configs = choice("Configuration", [], null, (value) => select(() => ({ config: value, frame: frameShown() })));
const oracles = element("input", { type: "checkbox" });
const oracleSteps = element("label", { class: "choice" }, oracles, " oracle steps");
const chip = element("span", { class: "chip" });
const visited = element("span");
chip.append(visited, button("×", () => select(() => ({ frame: frameShown(), visits: null })), { "aria-label": "N and P visit wrong frames again" }));

function fillLists() {
  const { track, lane, visits } = shown;
  const fill = (list, names, chosen) => {
    const select = list.querySelector("select");
    if (names.join("\n") !== [...select.options].map((each) => each.value).join("\n")) {
      select.replaceChildren(...names.map((name) => element("option", { value: name }, name)));
    }
    select.value = chosen;
  };
  clips.querySelector("select").value = track.clip;
  fill(subjects, data.clips[track.clip].subjects, track.subject);
  fill(configs, strips().map((each) => each.name), lane.name);
  oracleSteps.hidden = !track.lanes.some((each) => each.oracle);
  chip.hidden = !visits;
  if (visits) visited.textContent = `N and P: ${[visits.name, visits.config, ...(visits.clip < 0 ? [] : [data.clips[visits.clip].name])].join(", ")} `;
}

const steps = () => [
  button("P ‹ wrong", () => step(-1), { "aria-label": "Previous wrong frame (P)" }),
  button("wrong › N", () => step(1), { "aria-label": "Next wrong frame (N)" }),
];

export function drawTimeline(root) {
  root.append(element("div", { class: "controls" }, clips, subjects, configs, oracleSteps, ...(data.overall.length ? [...steps(), chip] : [])), sheet);
  listen();
  new ResizeObserver(redraw).observe(sheet);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  onSelection((why) => {
    const { track, lane, i } = shown;
    preview = null;
    const clip = data.clips[track.clip].name;
    const words = i === null ? `${track.subject} in ${clip}, ${lane.name}; no frame chosen` : frameInWords(track, lane, i);
    for (const [key, value] of Object.entries({
      "aria-label": `Timeline of ${track.subject} in ${clip}`, "aria-valuemin": track.frames[0], "aria-valuemax": track.frames.at(-1),
      "aria-valuenow": track.frames[i ?? 0], "aria-valuetext": words, "data-clip": clip, "data-config": lane.name, "data-subject": track.subject, "data-frame": i === null ? "" : track.frames[i],
    })) sheet.setAttribute(key, value);
    fillLists();
    arrange();
    if (i !== null) followInRecording(track, lane, i);
    if (!why.jump) return;
    document.getElementById("frames").scrollIntoView({ block: "start" });
    sheet.focus({ preventScroll: true });
  });
}
