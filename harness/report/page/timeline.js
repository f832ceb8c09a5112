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
const lists = element("div", { class: "controls" });
let [lanes, withOracles, scheduled, preview] = [[], false, false, null];
const followers = [];

// `listener` is called with {track, lane, i} under the pointer, and with null when it leaves.
export const onPreview = (listener) => followers.push(listener);

const strips = () => shown.track.lanes.filter((each) => withOracles || !each.oracle || each === shown.lane);

function arrange() {
  const { track } = shown;
  view.count = track.frames.length;
  const below = isScored(track) ? [truthLane(track), ...strips().map(stripLane)] : strips().map((lane) => answersLane(track, lane));
  lanes = [axisLane(track, data.clips[track.clip].per_second), ...below];
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
    select({ config: found.lane.name, frame: found.track.frames[found.i] });
    openRecording(found.track, found.lane, found.i);
  });
  sheet.addEventListener("keydown", onKey);
}

function onKey(event) {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const { track, lane, i } = shown;
  const goto = (next) => select({ frame: track.frames[Math.min(Math.max(next, 0), track.frames.length - 1)] });
  const other = (by) => {
    const all = strips();
    select({ config: all[(all.indexOf(lane) + by + all.length) % all.length].name, frame: track.frames[i ?? 0] });
  };
  const goals = {
    ArrowRight: () => goto((i ?? -1) + 1), ArrowLeft: () => goto(i - 1), ArrowDown: () => other(1), ArrowUp: () => other(-1),
    PageDown: () => goto(i + 25), PageUp: () => goto(i - 25), Home: () => goto(0), End: () => goto(track.frames.length - 1),
    Enter: () => i !== null && openRecording(track, lane, i),
  };
  const goal = goals[event.key];
  if (!goal) return;
  event.preventDefault();
  goal();
}

// Lists and buttons above it

function fillLists() {
  const { track, lane } = shown;
  const frame = track.frames[shown.i];
  const clip = choice("Clip", data.clips.map((each, i) => [i, each.name]), track.clip, (value) => select({ clip: Number(value), visits: null }));
  const subject = choice("Subject", data.clips[track.clip].subjects.map((each) => [each, each]), track.subject, (value) => select({ subject: value }));
  const config = choice("Configuration", strips().map((each) => [each.name, each.name]), lane.name, (value) => select({ config: value, frame }));
  const oracles = element("input", { type: "checkbox" });
  oracles.checked = withOracles;
  oracles.addEventListener("change", () => { withOracles = oracles.checked; fillLists(); arrange(); });
  const { name, config: only, clip: where } = shown.visits ?? {};
  const visits = shown.visits ? [element("span", { class: "chip" }, `N and P: ${[name, only, ...(where < 0 ? [] : [data.clips[where].name])].join(", ")} `,
    button("×", () => select({ frame, visits: null }), { "aria-label": "N and P visit wrong frames again" }))] : [];
  const focused = [...lists.querySelectorAll("select, button, input")].indexOf(document.activeElement);
  lists.replaceChildren(clip, subject, config,
    ...(track.lanes.some((each) => each.oracle) ? [element("label", { class: "choice" }, oracles, " oracle steps")] : []),
    ...(data.overall.length ? steps() : []), ...visits);
  if (focused >= 0) lists.querySelectorAll("select, button, input")[focused]?.focus();
}

const steps = () => [
  button("P ‹ wrong", () => step(-1), { "aria-label": "Previous wrong frame (P)" }),
  button("wrong › N", () => step(1), { "aria-label": "Next wrong frame (N)" }),
];

export function drawTimeline(root) {
  root.append(lists, sheet);
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
