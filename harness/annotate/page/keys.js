// Every action of the page with its keys: the keyboard, the tool bar and the table of keys use this list.

const rows = (page) => [
  ["play", ["Space"], "play or pause", "▶", () => page.player.toggle()],
  ["play-back", ["j"], "play backwards; again: twice as fast", "", () => page.shuttle(-1)],
  ["pause", ["k"], "pause", "", () => page.player.stop()],
  ["play-on", ["l"], "play; again: twice as fast", "", () => page.shuttle(1)],
  ["back", ["ArrowLeft"], "one frame back", "←", () => page.navigation.step(-1)],
  ["on", ["ArrowRight"], "one frame on", "→", () => page.navigation.step(1)],
  ["back-10", ["Shift+ArrowLeft"], "ten frames back", "", () => page.navigation.step(-10)],
  ["on-10", ["Shift+ArrowRight"], "ten frames on", "", () => page.navigation.step(10)],
  ["previous-change", ["["], "to the previous change of the label or of the suggestion", "[", () => page.navigation.toChange(-1)],
  ["next-change", ["]"], "to the next change of the label or of the suggestion", "]", () => page.navigation.toChange(1)],
  ["unlabelled", ["g"], "to the next frames without a label, of every subject", "", () => page.navigation.toOpen("unlabelled")],
  ["undecided", ["x"], "to the next suggestion that is undecided", "", () => page.navigation.toOpen("undecided")],
  ["label-first", ["q"], "to the next frames to label first, where configurations differ; they become the range", "label first", () => page.navigation.toOpen("label first"), "run"],
  ["first", ["Home"], "to the first frame", "", () => { page.go(0); }],
  ["last", ["End"], "to the last frame", "", () => { page.go(page.total - 1); }],
  ["slower", ["-"], "play slower", "", () => page.faster(.5)],
  ["faster", ["+", "="], "play faster", "", () => page.faster(2)],
  ["undo", ["z", "Ctrl+z"], "undo the last change of labels, targets or drawing", "↶", () => page.undo("undo")],
  ["redo", ["y", "Ctrl+y", "Ctrl+Shift+z", "Shift+z"], "redo", "↷", () => page.undo("redo")],
  ["earlier", [","], "move the last change a frame earlier", "", () => page.labelActions.nudge(-1)],
  ["later", ["."], "move the last change a frame later", "", () => page.labelActions.nudge(1)],
  ["find", ["f"], "find: a target's key goes to its next stretch; f again: the last target's", "find", () => page.navigation.startFinding(1)],
  ["find-before", ["Shift+f"], "the same, to the stretch before", "", () => page.navigation.startFinding(-1)],
  ["stretch", ["c"], "choose the frames around this one with the same label as the range (or double click)", "", () => page.selectStretch()],
  ["clear", ["Delete", "Backspace"], "remove the label: of the range, else from here to the next change", "", () => page.labelActions.clear()],
  ["begin", ["b"], "begin a range here", "", () => page.bound(false)],
  ["end", ["e"], "end the range here", "", () => page.bound(true)],
  ["loop", ["o"], "play the range over and over, or no more", "loop", () => page.loop()],
  ["subject", ["s"], "the next subject", "next subject", () => page.navigation.nextSubject(1), "several"],
  ["subject-before", ["Shift+s"], "the subject before", "", () => page.navigation.nextSubject(-1), "several"],
  ["confirm", ["Enter"], "confirm the suggestion here, go to the next", "confirm", () => page.labelActions.confirm(), "run"],
  ["accept", ["a"], "take over suggestions with high attention", "accept", () => page.labelActions.accept(), "run"],
  ["unsure", ["u"], "from the least sure suggestion to surer ones, and round again", "unsure", () => page.navigation.unsure(1), "run"],
  ["unsure-before", ["Shift+u"], "back to the one before", "", () => page.navigation.unsure(-1), "run"],
  ["right", ["r"], "the right view", "right", () => page.beside("right")],
  ["disparity", ["d"], "the disparity", "disparity", () => page.beside("disparity")],
  ["head", ["h"], "the head, enlarged", "head", () => page.head()],
  ["drawing", ["p"], "draw boxes, points and heads that no model finds", "draw", () => page.drawing.toggle()],
  ["closer", ["v"], "enlarge the image; so does the wheel, and dragging moves it", "", () => page.stage.view.zoom(1.5)],
  ["farther", ["Shift+v"], "the image smaller again", "", () => page.stage.view.zoom(1 / 1.5)],
  ["timeline-closer", ["w"], "enlarge the timeline", "", () => page.zoomTimeline(2)],
  ["timeline-farther", ["Shift+w"], "the timeline smaller again", "", () => page.zoomTimeline(.5)],
  ["note", ["m"], "a note and tags on the label here", "note", () => page.labelActions.note()],
  ["target", ["t"], "a new target", "+ target", () => page.names.forms.ask(null, [])],
  ["escape", ["Escape"], "let go of the range, or of the search", "", () => page.escape()],
  ["help", ["?"], "show or hide the keys", "?", () => help.toggle()],
];

const FORMS = ["note", "target"]; // actions that open one

// The table of keys, above everything.
const help = {
  get root() { return document.getElementById("help"); },
  toggle() { if (this.root.open) this.root.close(); else this.root.showModal(); },
};

const named = { " ": "Space" };
const shown = { ArrowLeft: "←", ArrowRight: "→", "Shift+ArrowLeft": "Shift ←", "Shift+ArrowRight": "Shift →" };

function pressed(event) {
  const key = named[event.key] || (event.key.length === 1 ? event.key.toLowerCase() : event.key);
  const shift = event.shiftKey && /^([a-z]|Arrow.*)$/.test(key) ? "Shift+" : "";
  return `${event.ctrlKey || event.metaKey ? "Ctrl+" : ""}${shift}${key}`;
}

const typing = (element) => element && ["INPUT", "SELECT", "TEXTAREA"].includes(element.tagName);

// An element focused by the Tab key handles Enter and Space itself.
const pressing = (event) => ["Enter", " "].includes(event.key) && document.activeElement.closest("button, summary");

// A mouse click leaves no focus, so that the next Space plays.
export const onPress = (button, run) => button.addEventListener("click", (event) => {
  if (event.detail) button.blur();
  run();
});

// What is typed for a form that is not open yet, because its key waits: the form's text, and no key of the page.
class Early {
  constructor() { this.text = null; }

  until(opened) {
    this.text ??= "";
    opened.then(() => {
      if (typing(document.activeElement)) document.activeElement.value += this.text;
      this.text = null;
    });
  }

  takes(event) {
    if (this.text === null) return false;
    event.preventDefault();
    if (event.key === "Backspace") this.text = this.text.slice(0, -1);
    else if (event.key.length === 1 && !event.ctrlKey && !event.metaKey) this.text += event.key;
    return true;
  }
}

// The keyboard and the tool bar; returns the handler of a key press.
export function bind(page, names) {
  const possible = { run: page.hasRun, several: page.about.subjects.length > 1 };
  const actions = rows(page).filter((row) => possible[row[5]] ?? true);
  const byKey = new Map(actions.flatMap((row) => row[1].map((key) => [key, row])));
  const early = new Early();
  const queue = (id, run) => {
    if (id === "drawing") return run(); // at once: the next key is for it
    const done = page.keyQueue.press(run);
    if (FORMS.includes(id)) early.until(done);
  };
  const press = (event) => {
    if (typing(document.activeElement) || pressing(event) || event.altKey) return;
    if (help.root.open && event.key !== "?") return;
    if (early.takes(event)) return;
    const name = event.ctrlKey || event.metaKey ? undefined : names.ofKey(event);
    const row = byKey.get(pressed(event));
    if (!name && !row) return;
    event.preventDefault();
    if (name) page.keyQueue.press(() => page.choose(name));
    else queue(row[0], row[4]);
  };
  addEventListener("keydown", press);
  const queued = ([id, keys, words, sign, run]) => tool(id, keys, words, sign, () => queue(id, run));
  document.getElementById("tools").replaceChildren(...actions.filter((row) => row[3]).map(queued));
  document.getElementById("keys").replaceChildren(
    line("1 2 3 …", "click on it: the subject looks at it, from here until the next change; or in the range"),
    line("n, i", "looks at nothing in the scene; do not score"),
    ...actions.map((row) => line(row[1].map((key) => shown[key] || key).join(", "), row[2])),
  );
  onPress(document.querySelector("#help button"), () => help.toggle());
  return press;
}

function tool(id, keys, words, sign, run) {
  const button = Object.assign(document.createElement("button"), { id: `do-${id}`, title: `${words} (${shown[keys[0]] || keys[0]})`, textContent: sign });
  button.setAttribute("aria-label", words);
  onPress(button, run);
  return button;
}

function line(keys, words) {
  const row = document.createElement("tr");
  row.append(...[keys, words].map((text) => Object.assign(document.createElement("td"), { textContent: text })));
  return row;
}
