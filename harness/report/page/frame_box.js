// The box of one frame: the truth, the answer, the error type, the picture, the attention.

import { drawn, element } from "./dom.js";
import { labelLink } from "./label.js";
import { openRecording, recordingAddress, VIEWER, viewCommand } from "./recordings.js";
import { close, onSelection, outcomeInWords, shown } from "./selection.js";
import { data, packedJson } from "./packs.js";
import { isWrong, nameOf, placeOfValues, predictedInWords, predictedName, stateOf, valueAt, withValues } from "./store.js";
import { onPreview } from "./timeline.js";

const box = document.getElementById("frame");
const shift = { serial: 0 };

const truthOf = ({ track, i }) => nameOf(track.truth[i]) ?? "not annotated";
const answerOf = ({ lane, i }) => predictedName(lane, i);
const decimals = (value) => (value === null ? "–" : value.toFixed(2));

async function show(at) {
  const serial = (shift.serial += 1);
  const { track, lane, i } = at;
  const pictures = await packedJson(`pictures-${track.clip}`);
  await withValues(track.clip);
  if (serial !== shift.serial) return;
  const dismiss = element("button", { type: "button", class: "dismiss", "aria-label": "Close (Esc)" }, "×");
  dismiss.addEventListener("click", close);
  box.replaceChildren(element("div", {},
    element("div", {},
      element("h3", {}, `Frame ${track.frames[i]} – ${outcomeInWords(stateOf(lane, i))}`),
      element("p", {}, `${data.clips[track.clip].name}, ${track.subject}, ${lane.name}`),
      element("p", {}, `Truth: ${truthOf(at)}. Predicted: ${predictedInWords(lane, i)}.`, ...why(at)),
      data.is_recorded ? element("code", {}, viewCommand(track, lane, i)) : element("p", {}, "Not recorded: to scrub, run with --recording light."),
      ...link(at), ...labelLink(at)),
    ...thumbnail(at, pictures),
    values(at)), dismiss);
  box.hidden = false;
}

function hide() {
  shift.serial += 1;
  box.hidden = true;
}

function why({ lane, i }) {
  const words = data.error_types[stateOf(lane, i)];
  return words ? [element("br"), `${words[0].toUpperCase()}${words.slice(1)}.`] : [];
}

function link({ track, lane, i }) {
  const address = recordingAddress(track, lane, i);
  if (!address) return [];
  const opens = element("a", { href: address, target: VIEWER }, "Open the recording at this frame");
  opens.addEventListener("click", (event) => {
    if (event.ctrlKey || event.metaKey || event.shiftKey) return; // a tab of its own
    event.preventDefault();
    openRecording(track, lane, i);
  });
  return [element("p", {}, opens)];
}

// The picture of a wrong frame: the objects found, the truth (solid, thick, a tick) and the answer (dashed, a cross)

function thumbnail(at, found) {
  const { track, lane, i } = at;
  const frame = track.frames[i];
  const seen = found?.seen[track.subject]?.[lane.configuration]?.[frame];
  const picture = found?.pictures[frame];
  if (!seen || !picture) return isWrong(lane, i) ? fileBeside(track, frame) : [];
  const [width, height] = seen.size;
  const svg = drawn("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", class: "thumbnail" });
  svg.setAttribute("aria-label", `The left image of frame ${frame}: boxes, the head of ${track.subject}, cones; ` +
    `truth ${truthOf(at)}, predicted ${answerOf(at)}`);
  svg.append(drawn("image", { href: picture, width, height }));
  const truth = nameOf(track.truth[i]);
  const isTruth = (id, name) => (seen.truth === null ? name === truth : id === seen.truth);
  const roles = seen.boxes.map(([id, name]) => (id === seen.focus ? "predicted" : isTruth(id, name) ? "truth" : "other"));
  const inOrder = ["other", "truth", "predicted"].flatMap((role) =>
    seen.boxes.filter((_, k) => roles[k] === role).map(([, name, place]) => [role, name, place]));
  const labels = [];
  const outline = (kind, words, [left, top, right, bottom]) => {
    const place = { x: left, y: top, width: right - left, height: bottom - top };
    svg.append(drawn("rect", { class: "casing", ...place }), drawn("rect", { class: kind, ...place }));
    const low = Math.min(Math.max(top - 3, 11), height - 3);
    labels.push(drawn("text", { class: kind, x: Math.max(2, Math.min(left, width - 6.2 * words.length)), y: low }, words));
  };
  for (const [role, name, place] of inOrder) {
    if (role === "other") outline(role, name === track.subject ? "" : name, place);
  }
  for (const [cue, line] of seen.lines) {
    const points = Array.from({ length: line.length / 2 }, (_, k) => `${line[2 * k]},${line[2 * k + 1]}`).join(" ");
    svg.append(drawn("polyline", { class: cue, points }));
  }
  if (seen.head) outline("face", track.subject, seen.head);
  for (const [role, name, place] of inOrder) {
    if (role !== "other") outline(role, `${role === "truth" ? "✓ truth" : "✗ predicted"}: ${name}`, place);
  }
  svg.append(...labels);
  return [element("figure", {}, svg, element("figcaption", {}, "✓ solid: truth; ✗ dashed: answer; yellow: gaze; blue, dotted: head"))];
}

// The file of a picture that the page has no room for; none where the page has left its run's directory.
function fileBeside(track, frame) {
  if (!data.pictures) return [];
  const src = `${data.pictures}/${encodeURIComponent(data.clips[track.clip].name)}/${frame}.webp`;
  const image = element("img", { src, class: "thumbnail", alt: `The left image of frame ${frame}` });
  const figure = element("figure", {}, image, element("figcaption", {}, "The left image. The recording has boxes and cones."));
  image.addEventListener("error", () => figure.remove());
  return [figure];
}

function values({ track, lane, i }) {
  if (!lane.values) return element("p", { class: "small" }, lane.attended.length ? "" : "No attention values.");
  const place = placeOfValues(i, track.frames.length);
  const known = [...lane.values].map(([code, { total, gaze, head }]) => [code, ...[total, gaze, head].map((cells) => valueAt(cells, place))])
    .filter(([, total]) => total !== null).sort(([, a], [, b]) => b - a);
  const told = ([code, total]) => total > 0 || code === track.truth[i] || code === lane.predicted[i];
  const head = element("tr", {}, ...["Attention", "", "total", "gaze", "head"].map((words, column) =>
    element(words ? "th" : "td", words ? { scope: "col", class: column ? "n" : "" } : {}, words)));
  const rows = known.filter(told).map(([code, ...numbers]) => {
    const name = nameOf(code);
    const kind = code === track.truth[i] ? "truth" : code === lane.predicted[i] ? "wrong" : "other";
    const level = element("meter", { min: 0, max: 1, value: numbers[0], class: kind, "aria-label": `attention to ${name}` });
    const role = [code === track.truth[i] ? "truth" : "", code === lane.predicted[i] ? "predicted" : ""].filter(Boolean).join(", ");
    return element("tr", {}, element("th", { scope: "row" }, name, element("small", {}, role && ` (${role})`)),
      element("td", {}, level), ...numbers.map((each) => element("td", { class: "n" }, decimals(each))));
  });
  const others = known.filter((each) => !told(each)).map(([code]) => nameOf(code)).filter((name) => name !== "none");
  const rest = others.length ? `Attention below 0.002: ${others.join(", ")}.` : known.length ? "" : "No attention values.";
  const near = place === i ? "" : ` Values of frame ${track.frames[place]}.`;
  return element("div", {}, ...(rows.length ? [element("table", {}, head, ...rows)] : []), element("p", { class: "small" }, rest + near));
}

export function followFrames() {
  const pinned = () => (shown.track && shown.i !== null ? show(shown) : hide());
  onSelection(pinned);
  onPreview((at) => (at ? show(at) : pinned()));
}
