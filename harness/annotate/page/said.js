// Changes of the labels by a key or a click.

import { post } from "./api.js";
import { Form } from "./form.js";
import * as panel from "./panel.js";
import { at, nudged, runs } from "./tracks.js";

export class Said {
  constructor(page) {
    this.page = page;
    this.noteForm = new Form("note", () => this.noted());
  }

  // make(): returns the change when its turn comes, for the state after the one before; null for none.
  change(make) {
    const { page } = this;
    const { subject } = page;
    page.seen.tell();
    const id = crypto.randomUUID(); // sent again after a loss, it is not made twice
    let body;
    return page.queue.add(async () => {
      if (body === undefined) {
        const what = make(page.state.tracks[subject]);
        body = what && { id, revision: page.state.revision, subject, ...what };
      }
      if (body) await this.ask(body);
    });
  }

  async ask(body) {
    const state = await post("/api/change", body);
    panel.say("");
    this.page.update(state, state.revision);
  }

  look(target, point_px = null, here = this.page.here) {
    const { page } = this;
    if (target === page.subject) return;
    if (page.selection) {
      const [first, last] = page.selection;
      page.select(null);
      this.change(() => ({ kind: "range", at: first, last, target }));
    } else if (page.about.uncertain_first) this.change(() => ({ kind: "range", at: here, last: here, target }));
    else this.change(() => ({ kind: "look", at: here, target, point_px }));
  }

  // A click refers to the frame that is shown.
  chosen(object, point) {
    const { page } = this;
    if (!page.names.names.includes(object.name)) page.names.forms.ask(object, page.stage.scene.objects);
    else this.look(object.name, page.about.shared.includes(object.name) ? point : null, page.shown);
  }

  clear() {
    const { selection, here } = this.page;
    this.page.select(null);
    this.change((track) => {
      const [first, last] = selection || [here, at(runs(track), here).last];
      return { kind: "range", at: first, last, target: null };
    });
  }

  async nudge(by) {
    const { page } = this;
    const { here } = page;
    let moved = null;
    await this.change((track) => {
      moved = nudged(runs(track), here, by);
      return moved && { kind: "range", at: moved.at, last: moved.at, target: moved.target };
    });
    if (moved && by > 0 && page.wanted === moved.at) page.step(1);
  }

  async accept() {
    const { page } = this;
    if (!page.suggestions) return;
    await page.saved();
    const { revision } = page.state;
    const attention = panel.plenty();
    await this.change(() => ({ kind: "accept", attention }));
    if (page.state.revision === revision) panel.say(`There is nothing to take over: no suggestion of ${attention} or more where nothing is labelled.`);
  }

  async confirm() {
    const { page } = this;
    const { here } = page;
    await this.change(() => ({ kind: "confirm", at: here }));
    const next = page.track.find((each) => each.suggested && each.first > here) || page.track.find((each) => each.suggested);
    if (next) page.go(next.first, true);
  }

  async note() {
    const { page } = this;
    await page.saved();
    const here = at(page.track, page.wanted);
    this.noteAt = page.wanted;
    if (here.target === null) panel.say("There is no label here to put a note on.");
    else this.noteForm.open({ note: here.note });
  }

  noted() {
    const { noteAt, noteForm: { values: { note } } } = this;
    this.change(() => ({ kind: "note", at: noteAt, note }));
    this.noteForm.close();
  }
}
