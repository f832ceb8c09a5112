// Opens the files of one recording in Rerun's web viewer, at a frame: ?files=URL&files=URL&layout=URL&frame=5.
// Messages to the viewer are Protocol Buffers; the field numbers are those of Rerun 0.41.
"use strict";

const asked = new URLSearchParams(location.search);
const said = document.getElementById("said");
const [SET_TIME_CURSOR, TIMELINE, TIME, PLAY_STATE, PAUSED] = [6, 2, 3, 5, 1];
const [RECORDINGS, LOADING] = [3, 7]; // of the viewer's state

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

/** The fields that a message has; all fields of the viewer's state are texts or messages. */
function fieldsOf(bytes) {
  const found = new Set();
  let at = 0;
  const next = () => {
    let [value, shift] = [0, 0];
    do value += (bytes[at] & 127) * 2 ** shift, shift += 7;
    while (bytes[at++] & 128);
    return value;
  };
  while (at < bytes.length) {
    found.add(Math.floor(next() / 8));
    at += next(); // the length: it is skipped
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

async function fetched(url) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(await answer.text());
  return new Uint8Array(await answer.arrayBuffer());
}

async function open(handle) {
  const layout = asked.get("layout");
  if (layout) { // first: an open recording keeps its layout
    const bytes = await fetched(layout);
    handle.open_channel("layout", "layout");
    handle.send_rrd_to_channel("layout", bytes);
    handle.close_channel("layout");
  }
  for (const file of asked.getAll("files")) handle.add_receiver(new URL(file, location).href);
}

/** Go to the frame as soon as there is a recording, and again when all of it is there. */
async function goTo(handle, frame) {
  for (let [there, loaded] = [false, false]; !loaded; await new Promise((resolve) => setTimeout(resolve, 200))) {
    const fields = fieldsOf(handle.viewer_state());
    const whole = fields.has(RECORDINGS) && !fields.has(LOADING);
    if (there && !whole) continue;
    try {
      await handle.viewer_control(pausedAt(frame));
      [there, loaded] = [true, whole];
    } catch {
      // it has no recording yet
    }
  }
}

async function main() {
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  const handle = new wasm_bindgen.WebHandle({
    hide_welcome_screen: true,
    check_for_updates_on_startup: false,
    enable_history: false,
    persist: false,
  });
  await handle.start(document.getElementById("canvas"));
  window._handle = handle;
  said.textContent = "";
  await open(handle);
  const frame = asked.get("frame");
  if (frame !== null) await goTo(handle, frame);
}

main().catch((error) => {
  said.textContent = `The recording cannot be shown: ${error.message ?? error}`;
});
