// Opens the files of one recording in Rerun's web viewer, at a frame: ?files=URL&files=URL&layout=URL&frame=5.
// Messages to the viewer are Protocol Buffers; the field numbers are those of Rerun 0.41.
"use strict";

const asked = new URLSearchParams(location.search);
const said = document.getElementById("said");
const canvas = document.getElementById("canvas");
const warned = document.getElementById("warned");
const [SET_TIME_CURSOR, TIMELINE, TIME, PLAY_STATE, PAUSED] = [6, 2, 3, 5, 1];
const MOST_COVERED_MS = 30_000;
const SETTLED_MS = 300; // the viewer draws what has come, in our layout
const [IN_FRONT, RECORDINGS, LOADING] = [1, 3, 7]; // of the viewer's state

function varint(value) {
  const bytes = [];
  let rest = BigInt.asUintN(64, value);
  for (; rest > 127n; rest >>= 7n) bytes.push(Number(rest & 127n) | 128);
  return [...bytes, Number(rest)];
}

const number = (field, value) => [field * 8, ...varint(BigInt(value))];
const message = (field, bytes) => [field * 8 + 2, ...varint(BigInt(bytes.length)), ...bytes];

function pausedAt(frame) {
  const timeline = message(TIMELINE, message(1, new TextEncoder().encode("frame")));
  const time = message(TIME, number(1, frame));
  return new Uint8Array(message(SET_TIME_CURSOR, [...timeline, ...time, ...number(PLAY_STATE, PAUSED)]));
}

/** The fields of a message, as bytes; all fields of the viewer's state are texts or messages. */
function fieldsOf(bytes) {
  const found = new Map();
  let at = 0;
  const next = () => {
    let [value, shift] = [0, 0];
    do value += (bytes[at] & 127) * 2 ** shift, shift += 7;
    while (bytes[at++] & 128);
    return value;
  };
  while (at < bytes.length) {
    const [field, length] = [Math.floor(next() / 8), next()];
    found.set(field, bytes.subarray(at, (at += length)));
  }
  return found;
}

/** The viewer asks for recordings without the cookie that this server wants, and other hosts for things nobody wants. */
const ask = window.fetch.bind(window);
window.fetch = (what, how) => {
  const request = new Request(what, how);
  if (new URL(request.url).origin !== location.origin) return Promise.reject(new TypeError("only from this server"));
  return ask(new Request(request, { credentials: "same-origin" }));
};

window.addEventListener("keydown", (event) => {
  if (event.key === "Tab") event.stopPropagation(); // the viewer would keep the focus
}, { capture: true });

async function fetched(url) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(await answer.text());
  return new Uint8Array(await answer.arrayBuffer());
}

console.debug = () => {}; // the viewer writes 18,000 lines as it starts, for its own developers

const handle = new Promise((resolve) => { window._started = resolve; });
const layouts = new Map(); // the layout that each application shows
const opened = new Set();
let serial = 0;

/** Whether the browser decodes a video; the viewer leaves the decoding to it. */
async function decodes(codec) {
  return "VideoDecoder" in window && (await VideoDecoder.isConfigSupported({ codec })).supported;
}

async function warnOfVideo(codec, isWanted) {
  const isShown = !codec || await decodes(codec);
  if (isWanted()) warned.hidden = isShown;
}

/** Whether every file is there, so that the viewer shows them in our layout. */
function isWhole(viewer) {
  const fields = fieldsOf(viewer.viewer_state());
  return fields.has(RECORDINGS) && !fields.has(LOADING);
}

/** Hide what the viewer draws of a recording that is still loading: a layout of its own, for some seconds. */
async function coverUntilWhole(viewer, isWanted) {
  canvas.classList.add("covered");
  said.textContent = "Loading the recording …";
  for (let left = MOST_COVERED_MS; left > 0 && isWanted() && !isWhole(viewer); left -= 50) {
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  if (!isWanted()) return; // the later call covers, too, or shows what is there
  await new Promise((resolve) => setTimeout(resolve, SETTLED_MS));
  uncover();
}

function uncover() {
  canvas.classList.remove("covered");
  said.textContent = "";
}

/** Show the files of a recording in a layout at a frame. A later call takes over from one that still waits. */
async function show(asked) {
  const mine = (serial += 1);
  await warnOfVideo(asked.get("codec"), () => mine === serial);
  const viewer = await handle;
  const [layout, application, frame] = ["layout", "application", "frame"].map((key) => asked.get(key));
  if (layout && layouts.get(application) !== layout) { // first: an open recording keeps its layout
    const bytes = await fetched(layout);
    if (mine !== serial) return;
    layouts.set(application, layout);
    const channel = `layout ${mine}`;
    viewer.open_channel(channel, channel);
    viewer.send_rrd_to_channel(channel, bytes);
    viewer.close_channel(channel);
  }
  const files = asked.getAll("files").map((file) => new URL(file, location).href);
  const missing = files.filter((file) => !opened.has(file));
  if (!missing.length && !isInFront(viewer, application)) missing.push(files[0]); // it comes to the front again
  const isNew = missing.some((file) => !opened.has(file));
  for (const file of missing) {
    opened.add(file);
    viewer.add_receiver(file);
  }
  if (isNew || canvas.classList.contains("covered")) coverUntilWhole(viewer, () => mine === serial);
  else uncover();
  if (frame !== null) await goTo(viewer, application, frame, () => mine === serial);
}

/** Show what an address of /open leads to. The report that opened this page calls it as well. */
async function showAddress(address) {
  const mine = (serial += 1);
  try {
    const answer = await fetch(address, { method: "HEAD" }); // the viewer's address, with files and layout
    if (!answer.ok) throw new Error(await (await fetch(address)).text());
    if (mine === serial) await show(new URL(answer.url).searchParams);
  } catch (error) {
    complain(error);
  }
}

function isInFront(viewer, application) {
  const shown = fieldsOf(viewer.viewer_state()).get(IN_FRONT);
  if (!application || !shown) return !application;
  return new URL(new TextDecoder().decode(shown), location).searchParams.get("app_id") === application;
}

/** Go to the frame as soon as there is a recording, and again when all of it is there. */
async function goTo(viewer, application, frame, isWanted) {
  for (let [there, loaded] = [false, false]; !loaded; await new Promise((resolve) => setTimeout(resolve, 200))) {
    if (!isWanted()) return;
    const whole = isWhole(viewer);
    if ((there && !whole) || !isInFront(viewer, application)) continue;
    try {
      await viewer.viewer_control(pausedAt(frame));
      [there, loaded] = [true, whole];
    } catch {
      // it has no recording yet
    }
  }
}

async function start() {
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  const viewer = new wasm_bindgen.WebHandle({
    hide_welcome_screen: true,
    check_for_updates_on_startup: false,
    enable_history: false,
    persist: false,
  });
  await viewer.start(canvas);
  window._handle = viewer;
  window._started(viewer);
  said.textContent = "";
}

function complain(error) {
  uncover();
  said.textContent = `The recording cannot be shown: ${error.message ?? error}`;
}

start().catch(complain);
if (asked.has("files")) show(asked).catch(complain);
