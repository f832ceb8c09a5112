// Drawing: boxes and points for targets that no segmenter knows, and heads that no detector finds, at key frames.

import { onPress } from "./keys.js";
import { isKey, nextKey, placeAt, stateAt } from "./keyframes.js";
import * as panel from "./panel.js";
import { Shapes } from "./shapes.js";

const PAUSE_MS = 300; // presses that follow each other faster move a shape once
const PART = { box: "", point: " (point)", head: " (head)" };
// Actions of other keys while drawing: moving through the clip, zooming, a new target.
const PASSED = new Set([..."jklvVrdhsStwW+-=?", " ", "ArrowLeft", "ArrowRight", "Home", "End", "Tab"]);

const rows = (drawing) => [
  ["done", ["p", "Escape"], "end drawing", "done", () => drawing.toggle()],
  ["set", ["Enter"], "a key frame here, as it is shown", "key frame", () => drawing.set()],
  ["before", ["["], "to the key frame before", "◆ ←", () => drawing.go(-1)],
  ["next", ["]"], "to the next key frame", "→ ◆", () => drawing.go(1)],
  ["outside", ["q"], "it leaves the image here, or is back", "outside", () => drawing.send("outside")],
  ["delete", ["Delete", "Backspace"], "no key frame here", "delete key frame", () => drawing.send("delete")],
  ["remove", ["Shift+Delete", "Shift+Backspace"], "not drawn at all", "remove", () => drawing.send("remove")],
  ["undo", ["z", "Ctrl+z"], "undo the last change of labels or drawing", "↶", () => drawing.page.undo("undo")],
  ["redo", ["y", "Ctrl+y", "Ctrl+Shift+z", "Z"], "redo", "↷", () => drawing.page.undo("redo")],
];
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class Drawing {
  // state: what is drawn; press(run): queue the action of a key or a button; look(name): a drawn shape was clicked to
  // label it.
  constructor(page, state, { press, look }) {
    Object.assign(this, { page, state, press });
    this.on = false;
    this.live = null; // the place while the pointer or the keys move it
    this.actions = rows(this);
    this.makePanel();
    this.shapes = new Shapes(page.stage, {
      chosen: () => this.what,
      choose: (name, kind) => this.choose(name, kind),
      live: (place) => { this.live = place; this.draw(); },
      done: (place) => this.drew(place),
      look,
    });
    addEventListener("keydown", (event) => this.key(event), true);
  }

  // Update the names.
  set about(about) {
    this.frames = about.frames.map(Number);
    this.all = about.names.filter((name) => name !== "none" && name !== "ignore");
    this.subjects = about.subjects;
    if (!this.what || !this.all.includes(this.what.name)) this.what = this.default(this.all[0]);
  }

  // A shape that was moved since it was sent keeps its place.
  take(state) {
    this.state = state;
    if (this.live === this.sent && !this.page.queue.pending.some(({ kind }) => kind === "draw")) this.live = null;
  }

  // Selection

  kinds(name) {
    if (this.subjects.includes(name)) return ["head", "box"];
    const known = this.state.tracks.find((each) => each.name === name);
    return known ? [known.kind] : ["box", "point"];
  }

  default(name) { return { name, kind: this.kinds(name)[0] }; }

  get track() {
    const { name, kind } = this.what;
    return this.state.tracks.find((each) => each.name === name && each.kind === kind);
  }

  choose(name, kind) {
    this.rest();
    this.live = null;
    this.what = { name, kind };
    this.draw();
  }

  // A target's key; pressed again, it switches to the other kind of shape.
  byKey(name) {
    const kinds = this.kinds(name);
    const now = this.what.name === name ? kinds.indexOf(this.what.kind) : 0;
    this.choose(name, kinds[this.keyed === name ? (now + 1) % kinds.length : now]);
    this.keyed = name;
  }

  // Actions

  toggle() {
    this.rest();
    this.on = !this.on;
    this.page.player.stop();
    document.body.classList.toggle("drawing", this.on);
    panel.say(this.on && this.state.read_only ? this.state.read_only : "");
    this.page.draw();
  }

  drew(place) {
    this.live = place;
    if (place) this.send("key", place); else this.draw();
  }

  // A key frame at the shown place; a shape that is not drawn yet begins in the middle of the image.
  set() {
    const { shown } = this.page;
    const [width, height] = this.shapes.size;
    const middle = this.what.kind === "point" ? [width / 2, height / 2] : [.4 * width, .4 * height, .6 * width, .6 * height];
    this.drew(this.live || (this.track ? placeAt(this.track, shown, this.frames) : middle));
  }

  // Move the shape by pixels of the image, or with Shift its lower right corner; sent after the last key press.
  nudge([right, down], isResize) {
    const { track, page: { shown } } = this;
    const place = this.live || (track && placeAt(track, shown, this.frames));
    if (!place) return;
    const moved = place.map((at, axis) => at + (isResize && axis < 2 ? 0 : [right, down][axis % 2]));
    if (moved.length === 4 && (moved[2] - moved[0] < 2 || moved[3] - moved[1] < 2)) return;
    this.live = moved;
    this.movedAt = shown;
    this.draw();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.rest(), PAUSE_MS);
    const { what } = this;
    this.resting = () => this.send("key", moved, what, shown);
    this.page.settle();
  }

  rest() {
    clearTimeout(this.timer);
    const { resting } = this;
    this.resting = null;
    if (resting) resting();
  }

  get waits() { return Boolean(this.resting); }

  go(direction) {
    const to = this.track && nextKey(this.track, this.page.shown, direction);
    if (to !== undefined) this.page.go(to);
  }

  send(action, place = [], what = this.what, at = this.page.shown) {
    this.rest();
    this.sent = this.live;
    this.page.queue.add({ kind: "draw", draw: { do: action, ...what, at, place } });
  }

  key(event) {
    const { activeElement } = document;
    if (!this.on || event.altKey || ["INPUT", "SELECT"].includes(activeElement.tagName)) return;
    if (["Enter", " "].includes(event.key) && activeElement.closest("button, summary")) return;
    const isCtrl = event.ctrlKey || event.metaKey;
    const step = isCtrl && STEPS[event.key];
    const name = isCtrl ? undefined : this.page.names.ofKey(event);
    const pressed = `${isCtrl ? "Ctrl+" : ""}${event.shiftKey && event.key.length > 1 ? "Shift+" : ""}${isCtrl ? event.key.toLowerCase() : event.key}`;
    const row = this.actions.find(([, keys]) => keys.includes(pressed));
    if (!step) this.rest();
    if (!this.all.includes(name)) this.keyed = null;
    if (!step && !name && !row && (isCtrl || PASSED.has(event.key))) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    const run = step ? () => this.nudge(step, event.shiftKey) : this.all.includes(name) ? () => this.byKey(name) : row && row[4];
    if (run) this.act(run, step ? "step" : row?.[0]);
  }

  // An action is on what is shown and saved by then. The tool itself opens and closes at once: the next key is for it, or
  // no longer.
  act(run, id) {
    if (id === "done") return run();
    const { page } = this;
    return this.press(async () => {
      await page.showing;
      if (id !== "step" || this.movedAt !== page.shown) this.rest();
      if (!page.player.playing) await page.saved();
      run();
    });
  }

  // Display

  makePanel() {
    this.panel = Object.assign(document.createElement("section"), { id: "drawing", hidden: true });
    this.panel.setAttribute("aria-label", "Drawing");
    this.select = Object.assign(document.createElement("select"), { id: "drawn-what" });
    this.select.setAttribute("aria-label", "What is drawn");
    this.select.addEventListener("change", () => {
      const [kind, ...name] = this.select.value.split(" ");
      this.choose(name.join(" "), kind);
      this.select.blur();
    });
    this.said = Object.assign(document.createElement("output"), { id: "drawn-state" });
    const buttons = this.actions.map(([id, keys, words, sign, run]) => {
      const button = Object.assign(document.createElement("button"), { id: `draw-${id}`, title: `${words} (${keys[0]})`, textContent: sign });
      button.setAttribute("aria-label", words);
      onPress(button, () => this.act(run, id));
      return button;
    });
    const help = Object.assign(document.createElement("p"), {
      textContent: "Drag on the image to draw; drag the box or a corner to change it. Its key chooses a target, again its other kind. Ctrl with arrows moves by a pixel, Ctrl and Shift change the size.",
    });
    this.panel.append(this.select, this.said, ...buttons, help);
    document.getElementById("tools").before(this.panel);
  }

  draw() {
    const { stage, names, shown } = this.page;
    if (!stage.scene || !this.what) return;
    const seen = new Set(stage.scene.objects.map((each) => each.name));
    const found = this.state.tracks.flatMap((track) => {
      const isChosen = this.on && track === this.track;
      const state = isChosen && this.live ? "key" : stateAt(track, shown);
      if ((state === "outside" || state === "before") && !isChosen) return [];
      if (!this.on && (seen.has(track.name) || track.kind === "head")) return []; // the page shows these itself
      const place = (isChosen && this.live) || placeAt(track, shown, this.frames);
      return [this.shown(track, place, state, isChosen)];
    });
    if (this.on && this.live && !this.track) found.push(this.shown(this.what, this.live, "key", true));
    found.sort((a, b) => a.isChosen - b.isChosen);
    this.shapes.draw(found, this.on);
    this.panel.hidden = !this.on;
    document.getElementById("do-drawing")?.setAttribute("aria-pressed", this.on);
    if (this.on) this.drawPanel(names);
  }

  shown({ name, kind }, place, state, isChosen) {
    const { names } = this.page;
    return { name, kind, place, state, isChosen, text: `${names.key(name)} ${name}${PART[kind]}`, className: names.className(name) };
  }

  drawPanel(names) {
    const { track, what, page: { shown }, state } = this;
    const options = this.all.flatMap((name) => this.kinds(name).map((kind) => {
      const isDrawn = state.tracks.some((each) => each.name === name && each.kind === kind);
      const words = `${names.key(name)} ${name}${PART[kind]}${isDrawn ? " ◆" : ""}`;
      return Object.assign(document.createElement("option"), { value: `${kind} ${name}`, textContent: words });
    }));
    this.select.replaceChildren(...options);
    this.select.value = `${what.kind} ${what.name}`;
    const here = track && stateAt(track, shown);
    const words = { key: "key frame", between: "between key frames", outside: "outside", before: "before the first key frame" };
    const count = track ? `, ${track.keys.length} in all` : "";
    this.said.value = `${track ? words[here] : "not drawn yet: drag on the image"}${count}`;
    const can = {
      set: true, done: true, before: Boolean(track) && nextKey(track, shown, -1) !== undefined,
      next: Boolean(track) && nextKey(track, shown, 1) !== undefined, outside: Boolean(track), remove: Boolean(track),
      delete: Boolean(track) && isKey(track, shown), undo: this.page.state.can_undo, redo: this.page.state.can_redo,
    };
    for (const [id, is] of Object.entries(can)) document.getElementById(`draw-${id}`).disabled = !is;
    document.getElementById("draw-outside").setAttribute("aria-pressed", here === "outside");
  }
}
