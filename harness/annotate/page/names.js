// What can be looked at: a key, a colour and a pattern for each name, and the form for a new one.

import { post } from "./api.js";
import { Form } from "./form.js";
import { onPress } from "./keys.js";

const COLOURS = 10;
const PATTERNS = 4; // with ten colours, twenty names look different
const DIGITS = "1234567890";

export class Names {
  // look(target): a name was chosen; changed(about): a target was added; failed(error).
  constructor({ look, changed, failed }) {
    Object.assign(this, { look, changed, failed });
    this.root = document.getElementById("names");
    this.form = new Form("new-target", () => this.add());
  }

  set(names) {
    this.names = names;
    this.free = names.filter((name) => name !== "none" && name !== "ignore");
    this.root.replaceChildren(...names.map((name) => this.button(name)));
  }

  button(name) {
    const button = document.createElement("button");
    button.dataset.target = name;
    button.className = this.className(name);
    const key = document.createElement("kbd");
    key.textContent = this.key(name);
    button.append(key, ` ${name}`);
    onPress(button, () => this.look(name));
    return button;
  }

  className(name) {
    if (name === "none" || name === "ignore") return `is-${name}`;
    const place = this.free.indexOf(name);
    return place < 0 ? "unknown" : `c${place % COLOURS} p${(place + Math.floor(place / 20)) % PATTERNS}`;
  }

  key(name) {
    if (name === "none" || name === "ignore") return name[0];
    const place = this.free.indexOf(name);
    if (place < 0 || place >= 2 * DIGITS.length) return "";
    return place < DIGITS.length ? DIGITS[place] : `⇧${DIGITS[place - DIGITS.length]}`;
  }

  // How an object is called and drawn on the picture.
  of({ name }) {
    const known = this.names.includes(name);
    return { text: `${known ? this.key(name) : "+"} ${name}`, className: known ? this.className(name) : "unnamed" };
  }

  // The name of a pressed key: digits, with shift for the second ten, n and i.
  ofKey(event) {
    const digit = /^(?:Digit|Numpad)(\d)$/.exec(event.code);
    const place = digit ? DIGITS.indexOf(digit[1]) : DIGITS.indexOf(event.key);
    if (place >= 0 && event.key.length === 1) return this.free[place + (event.shiftKey && digit ? DIGITS.length : 0)];
    return { n: "none", i: "ignore" }[event.key];
  }

  draw(subject, current) {
    for (const button of this.root.children) {
      const { target } = button.dataset;
      button.disabled = target === subject;
      button.setAttribute("aria-pressed", target === current);
    }
  }

  // Ask for the name of an instance that has none, or of anything.
  ask(object, objects) {
    this.rule = object ? ruleOf(object, objects) : {};
    document.getElementById("rule").textContent = this.rule.at_px ? `the one nearest to ${this.rule.at_px.join(", ")} px` : "";
    this.form.open({ name: "", category: object ? object.label : "" });
  }

  async add() {
    const { name, category } = this.form.values;
    try {
      this.changed(await post("/api/target", { name, rule: { ...this.rule, category } }));
      this.form.close();
    } catch (error) { this.failed(error); }
  }
}

// The category says enough where there is one of it; else the place does.
function ruleOf(object, objects) {
  if (objects.filter((each) => each.label === object.label).length < 2) return {};
  const [u0, v0, u1, v1] = object.box_px;
  return { at_px: [Math.round((u0 + u1) / 2), Math.round((v0 + v1) / 2)] };
}
