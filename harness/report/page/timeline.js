// The timeline of one subject: lanes on a canvas between two frames, an overview of the whole clip, pointer and keys.

import { copyCanvas, copyCsv, copySvgText } from "./copying.js";
import { button, choice, element } from "./dom.js";
import { DASHES, legendOf } from "./figure.js";
import { attentionLane, axisLane, pictureLane, rateLane, stripLane, toFrame, toX, truthLane } from "./lanes.js";
import { canvasPen, palette, svgPen } from "./pens.js";
import { openRecording } from "./recordings.js";
import { frameInWords, onSelection, outcomeInWords, select, shown, step } from "./selection.js";
import { data, packedJson } from "./packs.js";
import { nameOf, numberOf, stateOf, withValues } from "./store.js";

const LEAST = 6; // frames between the edges at the largest zoom
const view = { from: 0, to: 1, left: 0, width: 1 };
const sheet = element("canvas", { tabindex: "0", role: "slider", id: "timeline" });
const overview = element("canvas", { "aria-hidden": "true", class: "overview" });
const lists = element("div", { class: "controls" });
const names = element("ul", { class: "legend" });
let [track, lanes, withOracles, height, scheduled, preview] = [null, [], false, 0, false, null];
const followers = [];

// `listener` is called with {track, lane, i} under the pointer, and with null when it leaves.
export const onPreview = (listener) => followers.push(listener);

const stripsOf = (of) => of.lanes.filter((each) => withOracles || !each.oracle || each === shown.lane);
const look = (of) => (code) => {
  const all = Object.keys(of.colours).map(Number);
  return { colour: of.colours[code] ?? "rgb(150 150 150)", dash: DASHES[all.indexOf(code) % DASHES.length] };
};

// Lanes and their places

async function arrange() {
  const { track: of, lane } = shown;
  const strips = stripsOf(of);
  const rates = strips.filter((each) => !each.oracle || each === lane).map((each) => ({ lane: each, number: numberOf(each.name) }));
  const pictures = (await packedJson(`pictures-${of.clip}`))?.pictures;
  if (track !== of || shown.lane !== lane) return;
  lanes = [axisLane(of, data.clips[of.clip].rate_hz), rateLane(rates), truthLane(of), ...strips.map(stripLane),
    attentionLane(of, lane, look(of)), ...(pictures ? [pictureLane(of, pictures, () => redraw())] : [])];
  names.replaceChildren(...legendOf(rates.map(({ lane: each, number }) => ({ name: each.name, number }))).children,
    ...lane.attended.map((code) => {
      const { colour, dash } = look(of)(code);
      const sample = element("span", { class: "sample", style: `border-top: 3px ${dash ? "dashed" : "solid"} ${palette().shade(colour)}` });
      return element("li", {}, sample, nameOf(code));
    }));
  redraw();
  withValues(of.clip).then(() => redraw());
}

// The drawn lanes are cached as a picture: if only the cursor has moved (`lanesToo` false), it is shown again.
const still = element("canvas");
let stale = true;

export function redraw(lanesToo = true) {
  stale = stale || lanesToo;
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(() => {
    scheduled = false;
    if (!track || !sheet.clientWidth) return;
    const width = sheet.clientWidth;
    height = place(width);
    if (stale) {
      drawLanes(canvasPen(still, width, height), width);
      drawOverview();
      stale = false;
    }
    const pen = canvasPen(sheet, width, height);
    pen.image(still, 0, 0, width, height);
    drawCursor(pen);
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
  sheet.dataset.places = JSON.stringify({ first: track.frames[0], left: view.left, width: view.width, from: view.from, to: view.to, rows });
  return top + 4;
}

function drawLanes(pen, width) {
  const colours = palette();
  for (const lane of lanes) {
    const chosen = lane.lane === shown.lane && lane.lane;
    const at = view.left ? [view.left - 10, lane.top + Math.min(15, lane.height - 4)] : [2, lane.top - 3];
    const most = Math.floor((view.left || width) / 6.6) - 2;
    const words = lane.label.length > most ? `${lane.label.slice(0, most)}…` : lane.label;
    pen.text(...at, `${chosen ? "▸ " : ""}${words}`, colours.of(chosen ? "ink" : "soft"), { align: view.left ? "right" : "left", weight: chosen ? 700 : 400 });
    pen.clipped(view.left, lane.top - 1, view.width, lane.height + 2, () => lane.draw(pen, view, lane.top, colours));
  }
}

function drawCursor(pen) {
  const colours = palette();
  const i = preview?.i ?? shown.i;
  if (i !== null && i !== undefined && i + 1 > view.from && i < view.to) {
    const [x, wide] = [toX(view, i), Math.max(view.width / (view.to - view.from), 1.5)];
    pen.frame(x - 0.5, 1, wide, height - 6, colours.of("focus"), 1.5);
    const lane = lanes.find((each) => each.lane && each.lane === (preview?.lane ?? shown.lane));
    if (lane) pen.frame(x - 1, lane.top - 2, wide + 1, 23, colours.of("focus"), 3);
  }
}

function drawOverview() {
  const width = overview.clientWidth;
  const pen = canvasPen(overview, width, 30);
  const colours = palette();
  const whole = { from: 0, to: track.frames.length, left: 0, width };
  stripLane(shown.lane).draw(pen, whole, 5, colours);
  const [x, end] = [toX(whole, view.from), toX(whole, view.to)];
  pen.rect(0, 0, x, 30, colours.of("ground"), 0.62);
  pen.rect(end, 0, width - end, 30, colours.of("ground"), 0.62);
  pen.frame(x + 1, 1, Math.max(end - x - 2, 4), 28, colours.of("focus"), 2);
}

// Zoom and pan

function lookAt(from, to) {
  const count = track.frames.length;
  const wide = Math.min(Math.max(to - from, Math.min(LEAST, count)), count);
  view.from = Math.min(Math.max(from, 0), count - wide);
  view.to = view.from + wide;
  redraw();
}

function zoom(factor, centre = shown.i ?? (view.from + view.to) / 2) {
  lookAt(centre - (centre - view.from) * factor, centre + (view.to - centre) * factor);
}

function bringIntoView(i, centred) {
  const wide = view.to - view.from;
  if (i >= view.from && i + 1 <= view.to) return;
  const from = centred ? i - wide / 2 : i < view.from ? i - 0.1 * wide : i - 0.9 * wide;
  lookAt(from, from + wide);
}

// Pointer

function under(event) {
  const { left, top } = sheet.getBoundingClientRect();
  const [x, y] = [event.clientX - left, event.clientY - top];
  const i = Math.floor(toFrame(view, x));
  if (x < view.left || i < 0 || i >= track.frames.length) return null;
  return { i, lane: lanes.find((each) => each.lane && y >= each.top - 2 && y < each.top + each.height)?.lane ?? shown.lane };
}

function showPreview(found) {
  if (preview?.i === found?.i && preview?.lane === found?.lane) return;
  preview = found;
  for (const follow of followers) follow(preview && { track, ...preview });
  redraw(false);
}

function listen() {
  let held = null;
  sheet.addEventListener("pointerdown", (event) => { held = { x: event.clientX, from: view.from, to: view.to, moved: false }; });
  sheet.addEventListener("pointermove", (event) => {
    if (held && event.buttons) {
      const moved = event.clientX - held.x;
      if (Math.abs(moved) > 4) held.moved = true;
      const by = moved * (held.to - held.from) / view.width;
      if (held.moved) lookAt(held.from - by, held.to - by);
      return;
    }
    if (event.pointerType === "mouse") showPreview(under(event));
  });
  sheet.addEventListener("pointerleave", () => showPreview(null));
  sheet.addEventListener("click", (event) => {
    const found = held?.moved ? null : under(event);
    held = null;
    if (!found) return;
    preview = null;
    select({ config: found.lane.name, frame: track.frames[found.i] });
    openRecording(track, found.lane, found.i);
  });
  sheet.addEventListener("dblclick", (event) => zoom(0.4, under(event)?.i));
  sheet.addEventListener("wheel", (event) => {
    if (event.ctrlKey || event.metaKey) {
      event.preventDefault();
      zoom(Math.exp(event.deltaY / 300), toFrame(view, event.clientX - sheet.getBoundingClientRect().left));
    } else if (event.deltaX || event.shiftKey) {
      event.preventDefault();
      const by = (event.deltaX || event.deltaY) * (view.to - view.from) / view.width;
      lookAt(view.from + by, view.to + by);
    }
  }, { passive: false });
  overview.addEventListener("pointerdown", (event) => { overview.setPointerCapture(event.pointerId); slide(event); });
  overview.addEventListener("pointermove", (event) => { if (event.buttons) slide(event); });
  sheet.addEventListener("keydown", onKey);
}

function slide(event) {
  const at = track.frames.length * (event.clientX - overview.getBoundingClientRect().left) / overview.clientWidth;
  const wide = Math.min(view.to - view.from, view.to - view.from === track.frames.length ? track.frames.length / 4 : Infinity);
  lookAt(at - wide / 2, at + wide / 2);
}

function onKey(event) {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const { lane, i } = shown;
  const at = i ?? Math.floor(view.from);
  const strips = stripsOf(track);
  const goto = (next) => select({ frame: track.frames[Math.min(Math.max(next, 0), track.frames.length - 1)] });
  const other = (by) => select({ config: strips[(strips.indexOf(lane) + by + strips.length) % strips.length].name, frame: track.frames[at] });
  const goals = {
    ArrowRight: () => goto(i === null ? at : at + 1), ArrowLeft: () => goto(at - 1), ArrowDown: () => other(1), ArrowUp: () => other(-1),
    PageDown: () => goto(at + 25), PageUp: () => goto(at - 25), Home: () => goto(0), End: () => goto(track.frames.length - 1),
    "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), 0: () => lookAt(0, track.frames.length),
    Enter: () => i !== null && openRecording(track, lane, i),
  };
  const goal = goals[event.key];
  if (!goal) return;
  event.preventDefault();
  goal();
}

// Lists and buttons above it

function fillLists() {
  const { track: of, lane } = shown;
  const clip = choice("Clip", data.clips.map((each, i) => [i, each.name]), of.clip, (value) => select({ clip: Number(value), visits: null }));
  const subject = choice("Subject", data.clips[of.clip].subjects.map((each) => [each, each]), of.subject, (value) => select({ subject: value }));
  const config = choice("Configuration", stripsOf(of).map((each) => [each.name, each.name]), lane.name, (value) => select({ config: value, frame: of.frames[shown.i] }));
  const oracles = element("input", { type: "checkbox" });
  oracles.checked = withOracles;
  oracles.addEventListener("change", () => { withOracles = oracles.checked; fillLists(); arrange(); });
  const { name, config: only, clip: where } = shown.visits ?? {};
  const visits = shown.visits ? [element("span", { class: "chip" }, `N and P: ${[name, only, ...(where < 0 ? [] : [data.clips[where].name])].join(", ")} `,
    button("×", () => select({ frame: of.frames[shown.i], visits: null }), { "aria-label": "N and P visit wrong frames again" }))] : [];
  const focused = [...lists.querySelectorAll("select, button, input")].indexOf(document.activeElement);
  lists.replaceChildren(clip, subject, config,
    ...(of.lanes.some((each) => each.oracle) ? [element("label", { class: "choice" }, oracles, " oracle steps")] : []),
    button("P ‹ wrong", () => step(-1), { "aria-label": "Previous wrong frame (P)" }), button("wrong › N", () => step(1), { "aria-label": "Next wrong frame (N)" }), ...visits,
    button("−", () => zoom(2), { "aria-label": "Zoom out" }), button("+", () => zoom(0.5), { "aria-label": "Zoom in" }),
    button("all", () => lookAt(0, track.frames.length), { "aria-label": "Show the whole clip" }));
  if (focused >= 0) lists.querySelectorAll("select, button, input")[focused]?.focus();
}

function asCsv() {
  const strips = stripsOf(track);
  return [["frame", "truth", ...strips.flatMap((each) => [`${each.name} predicted`, `${each.name} outcome`])],
    ...track.frames.map((frame, i) => [frame, nameOf(track.truth[i]) ?? "",
      ...strips.flatMap((each) => [nameOf(each.predicted[i]) ?? "", outcomeInWords(stateOf(each, i))])])];
}

function asSvg() {
  const width = sheet.clientWidth;
  const pen = svgPen(width, height, palette().of("ground"));
  drawLanes(pen, width);
  drawCursor(pen);
  return pen.done();
}

export function drawTimeline(root) {
  root.append(lists, names, overview, sheet, element("p", { class: "copies" }, "Copy as ",
    button("CSV", () => copyCsv(asCsv()), { "aria-label": "Copy the timeline as CSV" }),
    button("PNG", () => copyCanvas(sheet), { "aria-label": "Copy the timeline as PNG" }),
    button("SVG", () => copySvgText(asSvg()), { "aria-label": "Copy the timeline as SVG" })));
  listen();
  new ResizeObserver(() => redraw()).observe(sheet);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (track) arrange(); });
  onSelection((why) => {
    const { track: of, lane, i } = shown;
    if (track !== of) [track, view.from, view.to] = [of, 0, of.frames.length];
    const words = i === null ? `${of.subject} in ${data.clips[of.clip].name}, ${lane.name}; no frame chosen` : frameInWords(of, lane, i);
    for (const [key, value] of Object.entries({
      "aria-label": `Timeline of ${of.subject} in ${data.clips[of.clip].name}`, "aria-valuemin": of.frames[0], "aria-valuemax": of.frames.at(-1),
      "aria-valuenow": of.frames[i ?? 0], "aria-valuetext": words, "data-clip": data.clips[of.clip].name, "data-config": lane.name, "data-subject": of.subject, "data-frame": i === null ? "" : of.frames[i],
    })) sheet.setAttribute(key, value);
    if (i !== null) bringIntoView(i, why.centre);
    fillLists();
    arrange();
    if (!why.jump) return;
    document.getElementById("frames").scrollIntoView({ block: "start" });
    sheet.focus({ preventScroll: true });
  });
}
