// Speaking turns: a second kind of label, with a row of its own below each subject who speaks.

import { get, post } from "./api.js";
import * as panel from "./panel.js";

export class Speech {
  constructor(page) {
    Object.assign(this, { page, turns: {}, begun: null });
  }

  async load() { this.take(await get("/api/speech")); }

  take({ turns }) {
    this.turns = turns;
    this.page.draw();
  }

  // First press: the subject begins to speak here; second press: the turn ends here.
  press() {
    const { page, begun } = this;
    const { subject, here } = page;
    if (!begun || begun.subject !== subject) {
      this.begun = { subject, at: here };
      panel.say(`${subject} speaks from here; c again where the turn ends.`);
      return;
    }
    this.begun = null;
    panel.say("");
    this.send({ subject, at: Math.min(begun.at, here), last: Math.max(begun.at, here) });
  }

  // Delete the turn here, or all speech in the range.
  silence() {
    const { page, begun } = this;
    this.begun = null;
    if (begun) return panel.say("");
    const turn = (this.turns[page.subject] || []).find(([first, last]) => first <= page.here && page.here <= last);
    const [at, last] = page.selection || turn || [];
    page.select(null);
    if (at !== undefined) this.send({ subject: page.subject, at, last, speaks: false });
  }

  undo() { this.send({ undo: true }); }

  send(what) {
    const body = { id: crypto.randomUUID(), ...what };
    this.page.queue.add(async () => this.take(await post("/api/speech", body)));
  }
}
