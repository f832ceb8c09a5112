// The targets: a key, a colour and a pattern for each name, which the name keeps.

import { onPress } from "./keys.js";
import { TargetForms } from "./targets.js";

const RESERVED = ["none", "ignore"];

export class Names {
  // look(target): a name was chosen; saved(): a promise; changed(answer): the targets have changed; failed(error).
  constructor({ look, saved, changed, failed }) {
    this.look = look;
    this.root = document.getElementById("names");
    this.forms = new TargetForms({ saved, changed, failed });
  }

  set(about) {
    this.names = about.names;
    this.looks = about.looks;
    this.byKey = new Map(Object.entries(this.looks).map(([name, { key }]) => [key, name]));
    this.root.replaceChildren(...this.names.map((name) => this.choice(name)));
    this.forms.set(about);
  }

  choice(name) {
    if (RESERVED.includes(name)) return this.button(name);
    const edit = Object.assign(document.createElement("button"), { className: "edit", textContent: "✎", title: `change ${name}` });
    edit.setAttribute("aria-label", `change ${name}: name, key, colour; delete`);
    onPress(edit, () => this.forms.edit(name));
    const both = document.createElement("span");
    both.append(this.button(name), edit);
    return both;
  }

  button(name) {
    const button = document.createElement("button");
    button.dataset.target = name;
    button.className = `look ${this.className(name)}`;
    const key = document.createElement("kbd");
    key.textContent = this.key(name);
    button.append(key, ` ${name}`);
    onPress(button, () => this.look(name));
    return button;
  }

  className(name) {
    if (RESERVED.includes(name)) return `is-${name}`;
    const look = this.looks[name];
    if (!look) return "unknown";
    const [hue, pattern] = look.colour.split(" ");
    return `c-${hue} p-${pattern}`;
  }

  key(name) {
    if (RESERVED.includes(name)) return name[0];
    return (this.looks[name]?.key || "").replace("shift+", "⇧");
  }

  // The name of an object, and its style on the picture.
  of({ name }) {
    const known = this.names.includes(name);
    return { text: `${known ? this.key(name) : "+"} ${name}`, className: known ? this.className(name) : "unnamed" };
  }

  // The target of a pressed key: digits, with shift for the second ten, n and i, also under Caps Lock.
  ofKey(event) {
    const digit = /^(?:Digit|Numpad)(\d)$/.exec(event.code);
    if (digit && event.key.length === 1) return this.byKey.get(`${event.shiftKey ? "shift+" : ""}${digit[1]}`);
    return this.byKey.get(event.key) ?? { n: "none", i: "ignore" }[event.shiftKey ? event.key : event.key.toLowerCase()];
  }

  draw(subject, current) {
    for (const button of this.root.querySelectorAll("[data-target]")) {
      const { target } = button.dataset;
      button.disabled = target === subject;
      button.setAttribute("aria-pressed", target === current);
    }
  }
}
