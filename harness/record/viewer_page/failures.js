// Steps through a run's wrong frames in the viewer beside it: /failures.json is the list, the address names the place.
"use strict";

const LABELS = { clip: "Clip", configuration: "Configuration", subject: "Subject", error_type: "Error type" };
const PLACE = ["clip", "configuration", "subject", "frame"]; // of a wrong frame, in the address
const list = document.getElementById("list");
const place = document.getElementById("place");
const filters = document.getElementById("filters");
const chosen = {}; // by key of LABELS
let failures = [];
let current = null;

const addressOf = (each) => new URLSearchParams(PLACE.map((key) => [key, each[key]]));
const isChosen = (each) => Object.entries(chosen).every(([key, value]) => !value || each[key] === value);

/** A list for each key with more than one value; each value with the number of wrong frames it would leave. */
function fillFilters() {
  filters.replaceChildren(...Object.entries(LABELS).flatMap(([key, label]) => {
    const others = failures.filter((each) => isChosen({ ...each, [key]: chosen[key] }));
    const counts = new Map([...new Set(failures.map((each) => each[key]))].map((value) => [value, 0]));
    if (counts.size < 2) return [];
    for (const each of others) counts.set(each[key], counts.get(each[key]) + 1);
    const options = [...counts].map(([value, count]) => make("option", { value }, `${key === "error_type" ? value.replaceAll("_", " ") : value} (${count})`));
    const select = make("select", { name: key }, make("option", { value: "" }, `all (${others.length})`), ...options);
    select.value = chosen[key] ?? "";
    select.addEventListener("change", () => {
      chosen[key] = select.value;
      fillFilters();
      fillList();
      if (!current || !isChosen(current)) go(failures.find(isChosen));
    });
    return [make("label", {}, `${label} `, select)];
  }));
}

function fillList() {
  list.replaceChildren(...failures.filter(isChosen).map((each) => {
    const where = `${each.clip}, ${each.configuration}, frame ${each.frame}`;
    const what = `${each.subject}: ${each.truth}, predicted ${each.predicted ?? "nothing"} (${each.error_type.replaceAll("_", " ")})`;
    const row = make("button", { type: "button", value: each.number }, where, make("br", {}), what);
    row.addEventListener("click", () => go(each));
    return make("li", {}, row);
  }));
  mark();
}

function mark() {
  const shown = failures.filter(isChosen);
  const at = shown.indexOf(current);
  place.textContent = shown.length ? `${at < 0 ? "–" : at + 1} of ${shown.length}` : "None of this kind.";
  for (const row of list.querySelectorAll("button")) {
    const isCurrent = current && Number(row.value) === current.number;
    if (isCurrent) row.setAttribute("aria-current", "true");
    else row.removeAttribute("aria-current");
    if (isCurrent) row.scrollIntoView({ block: "nearest" });
  }
}

function go(failure) {
  if (!failure) return;
  current = failure;
  history.replaceState(null, "", `#${addressOf(failure)}`);
  labelForm.close();
  mark();
  showAddress(failure.open);
}

function step(by) {
  const shown = failures.filter(isChosen);
  if (!shown.length) return;
  const at = shown.indexOf(current);
  const next = at < 0 ? (by > 0 ? 0 : shown.length - 1) : (at + by + shown.length) % shown.length;
  go(shown[next]);
}

/** The label of the current frame was written: its recording and the list are new, and the next wrong frame is shown. */
async function leave() {
  const [before, { number }] = [addressOf(current).toString(), current];
  await load();
  const rest = failures.filter(isChosen);
  const same = rest.find((each) => addressOf(each).toString() === before);
  const next = same ?? rest.find((each) => each.number >= number) ?? rest[0] ?? failures[0];
  if (next) history.replaceState(null, "", `#${addressOf(next)}`);
  sessionStorage.setItem("chosen", JSON.stringify(chosen));
  location.reload(); // the viewer would keep the old content of the recording
}

const labelForm = new LabelForm(document.getElementById("label"), leave);
const isWrong = () => current && labelForm.open({ clip: current.clip, subject: current.subject, frame: current.frame }).catch(complain);
document.getElementById("is-wrong").addEventListener("click", isWrong);
document.getElementById("next").addEventListener("click", () => step(1));
document.getElementById("previous").addEventListener("click", () => step(-1));
window.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest?.("input, select")) return;
  const by = { n: 1, p: -1 }[event.key.toLowerCase()];
  if (by) step(by);
  if (event.key.toLowerCase() === "w") {
    event.preventDefault(); // the letter is not for the form
    isWrong();
  }
}, { capture: true }); // the viewer's canvas has the focus, and lets no key through

async function load() {
  const found = await (await fetch("/failures.json")).json();
  failures = found.map((each, number) => ({ ...each, number: number + 1 }));
}

load().then(() => {
  Object.assign(chosen, JSON.parse(sessionStorage.getItem("chosen") ?? "{}"));
  sessionStorage.removeItem("chosen");
  if (!failures.some(isChosen)) Object.keys(chosen).forEach((key) => delete chosen[key]);
  fillFilters();
  fillList();
  if (!location.hash) return go(failures[0]);
  const asked = new URLSearchParams(location.hash.slice(1));
  const wanted = failures.find((each) => PLACE.every((key) => asked.get(key) === String(each[key])));
  if (wanted) return go(wanted);
  place.textContent = `The address names a frame that is not wrong here: ${PLACE.map((key) => `${key} ${asked.get(key) ?? "?"}`).join(", ")}.`;
}).catch(complain);
