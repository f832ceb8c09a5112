// How far a subject's frames were seen: told to the server a little later, so that playing does not tell every frame.

import { post } from "./api.js";

export class Seen {
  constructor(send) {
    this.send = send;
    this.last = null;
    this.timer = null;
    this.known = {}; // by subject; answers that were sent before it was told know less
  }

  get waits() { return this.last !== null; }

  note(subject, at, playing) {
    this.last = { subject, at };
    this.known[subject] = Math.max(at, this.known[subject] ?? -1);
    this.timer ??= setTimeout(() => this.tell(), playing ? 600 : 250);
  }

  tell() {
    const last = this.take();
    if (last) this.send(last);
  }

  // The page is closed: there is no time to wait for an answer.
  leave() {
    const last = this.take();
    if (last) post("/api/seen", last, true).catch(() => {});
  }

  // What the server does not know yet is not forgotten over its answer.
  keep(seen) {
    for (const [subject, at] of Object.entries(this.known)) seen[subject] = Math.max(seen[subject], at);
  }

  // The labels are others now: what was seen of those before counts no more.
  forget() { this.known = {}; }

  take() {
    clearTimeout(this.timer);
    const last = this.last;
    this.last = this.timer = null;
    return last;
  }
}
