// What can be looked at: a key, a colour and a pattern for each name, and the form for a new one.

import { post } from "./api.js";

const COLOURS = 10;
const PATTERNS = 4; // with ten colours, twenty names look different
const DIGITS = "1234567890";

export class Names {
  // look(target): a name was chosen; changed(about): a target was added; failed(error).
  constructor({ look, changed, failed }) {
    Object.assign(this, { look, changed, failed });
    this.root = document.getElementById("names");
    this.form = document.getElementById("new-target");
    this.form.addEventListener("submit", (event) => { event.preventDefault(); this.add(); });
    this.form.querySelector('[value="cancel"]').addEventListener("click", () => { this.form.hidden = true; });
  }

  set(names) {
    this.names = names;
    this.free = names.filter((name) => name !== "none" && name !== "ignore");
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

  // The name of a pressed key: digits, with shift for the second ten, n and i.
  ofKey(event) {
    const digit = /^(?:Digit|Numpad)(\d)$/.exec(event.code);
    const place = digit ? DIGITS.indexOf(digit[1]) : DIGITS.indexOf(event.key);
    if (place >= 0 && event.key.length === 1) return this.free[place + (event.shiftKey && digit ? DIGITS.length : 0)];
    return { n: "none", i: "ignore" }[event.key];
  }

  draw(subject, current) {
    this.root.replaceChildren(...this.names.map((name) => {
      const button = document.createElement("button");
      button.dataset.target = name;
      button.className = this.className(name);
      button.disabled = name === subject;
      button.setAttribute("aria-pressed", name === current);
      const key = document.createElement("kbd");
      key.textContent = this.key(name);
      button.append(key, ` ${name}`);
      button.addEventListener("click", () => { button.blur(); this.look(name); });
      return button;
    }));
  }

  // Ask for the name of an instance that has none, or of anything.
  ask(object, objects) {
    const { name, category } = this.form.elements;
    name.value = "";
    category.value = object ? object.label : "";
    this.rule = object ? ruleOf(object, objects) : {};
    document.getElementById("rule").textContent = this.rule.at_px ? `the one nearest to ${this.rule.at_px.join(", ")} px` : "";
    this.form.hidden = false;
    name.focus();
  }

  async add() {
    const { name, category } = this.form.elements;
    const rule = { ...this.rule, category: category.value.trim() };
    try {
      this.changed(await post("/api/target", { name: name.value.trim(), rule }));
      this.form.hidden = true;
      document.activeElement.blur();
    } catch (error) { this.failed(error); }
  }
}

// The category says enough where there is one of it; else the place does.
function ruleOf(object, objects) {
  if (objects.filter((each) => each.label === object.label).length < 2) return {};
  const [u0, v0, u1, v1] = object.box_px;
  return { at_px: [Math.round((u0 + u1) / 2), Math.round((v0 + v1) / 2)] };
}
