// The forms for targets: a new one, another name, key or colour, and deleting one.

import { post } from "./api.js";
import { Form } from "./form.js";

const find = (id) => document.getElementById(id);
const choice = (value, words, disabled = false) =>
  Object.assign(document.createElement("option"), { value, textContent: words, disabled });

export class TargetForms {
  // saved(): resolved when no change of labels waits; changed(answer): the server's answer with the new targets and
  // labels; failed(error).
  constructor({ saved, changed, failed }) {
    Object.assign(this, { saved, changed, failed });
    this.newForm = new Form("new-target", () => this.add());
    this.editForm = new Form("target", () => this.save());
    find("delete").addEventListener("click", () => this.remove());
  }

  set(about) {
    this.about = about;
    find("categories").replaceChildren(...about.categories.map((each) => choice(each, "")));
  }

  // Ask for the name of an unnamed instance, or of a new target.
  ask(object, objects) {
    this.rule = object ? ruleOf(object, objects) : {};
    find("rule").textContent = this.rule.at_px ? `the one nearest to ${this.rule.at_px.join(", ")} px` : "";
    this.newForm.open({ name: "", category: object ? object.label : "" });
  }

  edit(name) {
    const { looks, keys, colours, subjects, names } = this.about;
    const owner = Object.fromEntries(Object.entries(looks).map(([each, { key }]) => [key, each]));
    const { elements } = this.editForm.root;
    this.name = name;
    elements.key.replaceChildren(...keys.map((key) => {
      const isTaken = owner[key] !== undefined && owner[key] !== name;
      return choice(key, isTaken ? `${key} (${owner[key]})` : key, isTaken);
    }));
    if (!looks[name].key) elements.key.prepend(choice("", "no key"));
    elements.colour.replaceChildren(...colours.map((colour) => choice(colour, colour)));
    elements.to.replaceChildren(choice("", "nothing: it has none"), ...names.filter((each) => each !== name).map((each) => choice(each, each)));
    const isSubject = subjects.includes(name);
    elements.new_name.readOnly = isSubject;
    find("deletion").hidden = isSubject;
    this.editForm.open({ new_name: name, key: looks[name].key || "", colour: looks[name].colour, to: "" });
  }

  add() {
    const { name, category } = this.newForm.values;
    return this.send("/api/target", { name, rule: { ...this.rule, category } }, this.newForm);
  }

  save() {
    const { new_name: newName, key, colour } = this.editForm.values;
    return this.send("/api/target/change", { name: this.name, new_name: newName, key: key || null, colour }, this.editForm);
  }

  remove() {
    const { to } = this.editForm.values;
    return this.send("/api/target/delete", { name: this.name, to: to || null }, this.editForm);
  }

  async send(path, body, form) {
    if (form.isSent) return;
    form.isSent = true;
    try {
      await this.saved();
      this.changed(await post(path, body));
      form.close();
    } catch (error) { this.failed(error); }
    form.isSent = false;
  }
}

// The category identifies the target if there is only one of it; otherwise the place does.
function ruleOf(object, objects) {
  if (objects.filter((each) => each.label === object.label).length < 2) return {};
  const [u0, v0, u1, v1] = object.box_px;
  return { at_px: [Math.round((u0 + u1) / 2), Math.round((v0 + v1) / 2)] };
}
