// Changes of the labels by a key or a click. While the clip plays, none waits until it is saved: the next key would be
// for a later frame.

import { Form } from "./form.js";
import * as panel from "./panel.js";
import { at, runs } from "./tracks.js";

export class LabelActions {
  constructor(page) {
    this.page = page;
    this.noteForm = new Form("note", () => this.saveNote());
  }

  // Resolved when it is saved.
  change(what) {
    const { page } = this;
    page.lastSeen.tell();
    return page.queue.add({ subject: page.subject, ...what });
  }

  look(target, point_px = null, here = this.page.here) {
    const { page } = this;
    if (target === page.subject) return;
    if (page.selection) {
      const [first, last] = page.selection;
      page.select(null);
      this.change({ kind: "range", at: first, last, target });
    } else if (page.about.uncertain_first) this.change({ kind: "range", at: here, last: here, target });
    else this.change({ kind: "look", at: here, target, point_px });
  }

  // An object was clicked in the frame at a position.
  chosen(object, point, shown) {
    const { page } = this;
    if (page.names.names.includes(object.name)) return page.choose(object.name, page.about.shared.includes(object.name) ? point : null, shown);
    page.names.forms.ask(object, page.stage.scene.objects);
  }

  clear() {
    const { selection, here } = this.page;
    this.page.select(null);
    if (selection) this.change({ kind: "range", at: selection[0], last: selection[1], target: null });
    else this.change({ kind: "clear", at: here });
  }

  async nudge(by) {
    const { page } = this;
    const { here } = page;
    const mayStep = by > 0 && !page.player.playing;
    if (mayStep) await page.saved();
    const { first } = at(runs(page.track), here);
    const made = this.change({ kind: "nudge", at: here, by });
    if (!mayStep) return;
    await made;
    if (page.wanted === first && at(runs(page.track), first).first !== first) page.navigation.step(1);
  }

  async accept() {
    const { page } = this;
    if (!page.suggestions) return;
    const isPlaying = page.player.playing;
    if (!isPlaying) await page.saved();
    const { revision } = page.state;
    const attention = panel.plenty();
    const made = this.change({ kind: "accept", attention });
    if (isPlaying) return;
    await made;
    if (page.state.revision === revision) panel.say(`No frame was filled: frames without a label have no suggestion of ${attention} or more.`);
  }

  async confirm() {
    const { page } = this;
    const { here } = page;
    const made = this.change({ kind: "confirm", at: here });
    if (page.player.playing) return;
    await made;
    const next = page.track.find((each) => each.suggested && each.first > here) || page.track.find((each) => each.suggested);
    if (next) page.go(next.first, true);
  }

  async note() {
    const { page, page: { subject, here: position } } = this;
    await page.saved();
    const here = at(page.state.tracks[subject], position);
    if (here.target === null) return panel.say("There is no label here to put a note on.");
    this.noteFor = { subject, at: position };
    this.noteForm.open({ note: here.note, tags: here.tags });
  }

  // The label for which the form was opened, wherever the page is by now.
  saveNote() {
    const { noteFor, noteForm } = this;
    const { note, tags } = noteForm.values;
    this.change({ kind: "note", ...noteFor, note, tags });
    noteForm.close();
  }
}
