// Recordings: the tab that shows them on a served page, and the command that opens them.

import { data } from "./packs.js";

// One tab of the viewer is enough for all recordings.
export const VIEWER = "vfoa-viewer";
let [tab, last] = [null, null];

export function recordingAddress(track, lane, i) {
  const name = data.recordings?.[data.clips[track.clip].name]?.[lane.name];
  return name === undefined ? null : `open?${new URLSearchParams({ recording: name, frame: track.frames[i], subject: track.subject })}`;
}

export function openRecording(track, lane, i) {
  if (followInRecording(track, lane, i)) {
    tab.focus();
    return;
  }
  last = recordingAddress(track, lane, i);
  if (last) tab = window.open(last, VIEWER);
}

// If the viewer's tab is open, it shows this frame as well. Returns whether it is open.
export function followInRecording(track, lane, i) {
  const address = recordingAddress(track, lane, i);
  if (!address || !tab || tab.closed) return false;
  if (address !== last) {
    last = address;
    const whole = new URL(address, location).href;
    try {
      tab.showAddress(whole);
    } catch {
      tab.location.replace(whole); // it still starts, or shows another page
    }
  }
  return true;
}

// The run of a page on disk.
const run = data.run ?? (location.protocol === "file:"
  ? decodeURIComponent(new URL(data.folder, location).pathname).replace(/^\/(?=[A-Za-z]:)/, "").replace(/(?<=.)\/$/, "")
  : "RUN");

const quoted = (words) => (/^[\w@%+=:,./-]+$/.test(words) ? words : `'${words.replaceAll("'", `'"'"'`)}'`);

// The verdict and the notes of tables are the same wherever the run is (advice.py).
export const withRun = (text) => text.replaceAll("vfoa view RUN", () => `vfoa view ${quoted(run)}`);

export const viewCommand = (track, lane, i) =>
  `vfoa view ${quoted(run)} --clip ${quoted(data.clips[track.clip].name)} --config ${quoted(lane.name)} --frame ${track.frames[i]} --subject ${quoted(track.subject)}`;
