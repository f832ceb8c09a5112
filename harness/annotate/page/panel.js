// Texts around the picture.

import { clock } from "./axis.js";
import { onPress } from "./keys.js";

const find = (id) => document.getElementById(id);

export function say(text) {
  find("notice").textContent = text;
  find("notice").hidden = !text;
}

// The least attention of suggestions to accept.
export const plenty = () => Number(find("plenty").firstElementChild.value);

export function makePlenty(hasRun) {
  find("plenty").hidden = !hasRun;
  find("plenty").addEventListener("pointerup", (event) => event.target.blur());
  find("plenty").addEventListener("input", () => { find("plenty").lastElementChild.value = plenty(); });
}

export function drawTitle({ file, configuration, uncertain_first: uncertainFirst, blind, notice }) {
  find("title").textContent = file;
  document.title = `${file} – vfoa annotate`;
  const said = [configuration && `suggestions of ${configuration}`, uncertainFirst && "least sure first", blind && "blind"];
  find("mode").textContent = said.filter(Boolean).join(", ");
  find("read-only").textContent = notice || "";
  find("read-only").hidden = !notice;
}

export function drawPlace(number, position, total, { speed, times, stepS, loop }) {
  find("frame").value = number === null ? "Loading the first frame …"
    : `Frame ${number} (${position + 1} of ${total}), ${clock(times[position], stepS)}, plays at ×${speed}${loop ? ", loops" : ""}`;
}

export function makeUnlabelled(go) { onPress(find("unlabelled"), go); }

// The number of frames without a label, as a prominent button that goes to the next of them: of the subject or, if it
// has none, of the next that has.
export function drawUnlabelled(all) {
  const said = all.map(([subject, open]) => [subject, remaining(open)]);
  const [subject] = said[0];
  const next = said.find(([, words]) => words);
  const done = next && next[0] !== subject ? `${subject}: all labelled; ` : "";
  find("unlabelled").textContent = next ? `${done}${next[0]}: ${next[1]}` : `${subject}: all labelled`;
  find("unlabelled").classList.toggle("done", !next);
}

function remaining(open) {
  const count = (kind) => open.filter((each) => each.kind === kind).reduce((sum, each) => sum + each.last - each.first + 1, 0);
  const [unlabelled, undecided] = [count("unlabelled"), count("undecided")];
  return [unlabelled && `${unlabelled} without a label`, undecided && `${undecided} undecided`].filter(Boolean).join(", ");
}

// The range, by the frames' numbers.
export function drawRange(range) {
  find("range").value = range ? `frames ${range[0]} to ${range[1]}: a target's key labels them, Delete clears them` : "";
}

export function drawLabel(subject, { target, suggested, note, tags }) {
  const said = target === null ? "not labelled" : `${target}${suggested ? " (a suggestion)" : ""}`;
  find("label").value = `${subject}: ${said}${note ? ` – ${note}` : ""}${tags ? ` [${tags}]` : ""}`;
}

export function drawTools({ state, stage, player, navigation: { finding } }) {
  for (const kind of ["undo", "redo"]) find(`do-${kind}`).disabled = !state[`can_${kind}`];
  const open = { find: Boolean(finding), right: stage.beside === "right", disparity: stage.beside === "disparity", head: stage.zoomed, loop: player.loop !== null };
  for (const [id, is] of Object.entries(open)) find(`do-${id}`)?.setAttribute("aria-pressed", is);
}

export function makeSubjects(subjects, turnTo) {
  find("subjects").replaceChildren(...subjects.map((name) => {
    const button = Object.assign(document.createElement("button"), { textContent: name });
    onPress(button, () => turnTo(name));
    return button;
  }));
}

export function drawSubject(current) {
  for (const button of find("subjects").children) button.setAttribute("aria-pressed", button.textContent === current);
}

// Working time since the page was opened, without the rest of a longer pause, and the labels there were then.
const LONGEST_PAUSE_S = 30;
const work = { s: 0, last_s: null, begun: null };

// After a minute and a twentieth of the labels, so that the pace is known.
function timeLeft(labelled, total) {
  const now_s = performance.now() / 1000;
  work.begun ??= labelled;
  work.s += Math.min(now_s - (work.last_s ?? now_s), LONGEST_PAUSE_S);
  work.last_s = now_s;
  const gained = labelled - work.begun;
  if (labelled === total || work.s < 60 || gained < total / 20) return "";
  const left_s = work.s * (total - labelled) / gained;
  return `, about ${left_s < 90 ? `${Math.ceil(left_s)} s` : `${Math.ceil(left_s / 60)} min`} left`;
}

export function drawProgress({ labelled, total }) {
  find("bar").value = labelled / total;
  const share = `${labelled} of ${total} labelled (${Math.floor(100 * labelled / total)} %)`;
  find("share").textContent = `${share}${timeLeft(labelled, total)}`;
}
