// The labelling page: where it is in the clip, who is labelled, and what a key or a click does.

import { Queue, get, post } from "./api.js";
import { Drawing } from "./drawing.js";
import { Form } from "./form.js";
import { Names } from "./names.js";
import * as panel from "./panel.js";
import { Player } from "./player.js";
import { Seen } from "./seen.js";
import { Stage } from "./stage.js";
import { Strips } from "./strips.js";
import { at, changes, nudged, read, runs } from "./tracks.js";

const NEAR = 10; // a jump further than this does not count as having seen what lies between

export class Page {
  constructor(about, state) {
    this.subject = about.subjects[0];
    this.selection = null;
    this.queue = new Queue({ refused: (error) => this.refused(error), moved: () => this.settle() });
    this.seen = new Seen((seen) => this.queue.add(async () => this.update(await post("/api/seen", seen))));
    this.names = new Names({
      look: (name) => this.look(name), changed: (next) => this.renew(next), failed: (error) => panel.say(error.message),
    });
    this.stage = new Stage({ name: (each) => this.names.of(each), choose: (each, point) => this.chosen(each, point) });
    this.total = about.frames.length;
    this.drawing = new Drawing(this, { press: (run) => run(), look: (name) => this.look(name) });
    this.strips = new Strips({
      frames: about.frames,
      look: (name) => this.names.className(name),
      select: (range) => this.select(range),
      seek: (position, subject) => this.seek(position, subject || this.subject),
    });
    this.player = new Player(this, about.rate_hz);
    this.noteForm = new Form("note", () => this.noted());
    panel.makeSubjects(about.subjects, (name) => this.turnTo(name));
    this.wanted = this.shown = 0;
    this.take(about);
    this.state = read(state, about.to_decide);
    panel.makePlenty(this.hasRun);
    addEventListener("resize", () => this.draw()); // names are larger on a narrow screen
    addEventListener("pagehide", () => this.seen.leave());
    addEventListener("focus", () => this.queue.add(async () => this.update(await get("/api/state"))));
  }

  get hasRun() { return this.about.configuration !== null; }
  get track() { return this.state.tracks[this.subject]; }
  get suggestions() { return this.about.suggestions[this.subject]; }
  get order() { return this.about.order && this.about.order[this.subject]; }

  take(about) {
    this.about = about;
    this.names.set(about);
    panel.drawTitle(about);
    this.drawing.about = about;
  }

  // The targets are others now, and with another name the labels are, too.
  renew({ about, state }) {
    this.take(about);
    this.stage.scenes.clear();
    this.update(state, state.revision);
    this.go(this.shown);
  }

  // Where it is

  async go(position, near = false) {
    this.wanted = Math.min(Math.max(position, 0), this.total - 1);
    const wanted = this.wanted;
    this.settle();
    try {
      const [image, scene] = await this.stage.load(wanted);
      if (wanted !== this.wanted) return;
      this.shown = wanted;
      document.body.dataset.frame = this.about.frames[wanted];
      this.stage.show(image, scene, wanted, this.subject);
      this.see(wanted, near);
      this.draw();
      this.stage.ahead(wanted, 6, this.total);
    } catch (error) { panel.say(error.message || `frame ${this.about.frames[wanted]} cannot be shown`); }
    this.settle();
  }

  // Whether all that was asked for is shown, and all that was said is saved.
  settle() {
    document.body.setAttribute("aria-busy", this.wanted !== this.shown || this.queue.waiting > 0 || this.seen.waits || Boolean(this.drawing?.waits));
  }

  step(by) {
    this.player.stop();
    if (this.about.uncertain_first) return this.unsure(by);
    return this.go(this.wanted + by, true);
  }

  toChange(direction) {
    this.player.stop();
    const all = changes(this.track, this.suggestions);
    const next = direction > 0 ? all.find((each) => each > this.wanted) : all.reverse().find((each) => each < this.wanted);
    return this.go(next ?? (direction > 0 ? this.total - 1 : 0), true);
  }

  unsure(by) {
    this.player.stop();
    const rank = Math.min(Math.max(this.order.indexOf(this.wanted) + by, 0), this.total - 1);
    return this.go(this.order[rank]);
  }

  nextSubject(by) {
    const all = this.about.subjects;
    return this.turnTo(all[(all.indexOf(this.subject) + by + all.length) % all.length]);
  }

  turnTo(subject) {
    this.seek(null, subject);
    return this.go(this.start(), true);
  }

  seek(position, subject) {
    this.seen.tell();
    this.subject = subject;
    this.select(null);
    if (position !== null) this.go(position);
  }

  // Where a subject's work goes on: the first frame that is not labelled, confirmed or decided.
  start() {
    if (this.about.uncertain_first) return this.order[0];
    const seen = this.state.seen[this.subject];
    const isOpen = (each) => each.target === null || each.suggested || each.undecided || (each.carried && each.last > seen);
    const open = this.track.find(isOpen);
    if (!open) return 0;
    return open.carried ? Math.max(open.first, seen, 0) : open.first;
  }

  toggle() { this.player.toggle(); }
  faster(by) { this.player.faster(by); this.draw(); }
  beside(view) { this.stage.beside = this.stage.beside === view ? null : view; return this.go(this.wanted); }
  zoom() { this.stage.zoomed = !this.stage.zoomed; return this.go(this.wanted); }

  see(position, near) {
    const seen = this.state.seen;
    if (!near || position <= seen[this.subject] || position > seen[this.subject] + NEAR) return;
    seen[this.subject] = position;
    this.seen.note(this.subject, position, this.player.playing);
  }

  // What is said

  change(what) {
    const { subject } = this;
    this.seen.tell();
    return this.queue.add(async () => {
      const state = await post("/api/change", { revision: this.state.revision, subject, ...what });
      panel.say("");
      this.update(state, state.revision);
    });
  }

  look(target, point_px = null) {
    if (target === this.subject || !this.stage.scene) return; // nobody can judge what was never shown
    const here = this.player.playing ? this.shown : this.wanted;
    if (this.selection) {
      const [first, last] = this.selection;
      this.select(null);
      this.change({ kind: "range", at: first, last, target });
    } else if (this.about.uncertain_first) this.change({ kind: "range", at: here, last: here, target });
    else this.change({ kind: "look", at: here, target, point_px });
  }

  chosen(object, point) {
    if (!this.names.names.includes(object.name)) this.names.forms.ask(object, this.stage.scene.objects);
    else this.look(object.name, this.about.shared.includes(object.name) ? point : null);
  }

  clear() {
    const [first, last] = this.selection || [this.wanted, at(runs(this.track), this.wanted).last];
    this.select(null);
    this.change({ kind: "range", at: first, last, target: null });
  }

  nudge(by) {
    const moved = nudged(runs(this.track), this.wanted, by);
    if (!moved) return;
    this.change({ kind: "range", at: moved.at, last: moved.at, target: moved.target });
    if (by > 0 && this.wanted === moved.at) this.go(this.wanted + 1, true);
  }

  async accept() {
    if (!this.suggestions) return;
    const { revision } = this.state;
    const attention = panel.plenty();
    await this.change({ kind: "accept", attention });
    if (this.state.revision === revision) panel.say(`There is nothing to take over: no suggestion of ${attention} or more where nothing is labelled.`);
  }

  async confirm() {
    await this.change({ kind: "confirm", at: this.wanted });
    const next = this.track.find((each) => each.suggested && each.first > this.wanted) || this.track.find((each) => each.suggested);
    if (next) this.go(next.first, true);
  }

  note() {
    const here = at(this.track, this.wanted);
    this.noteAt = this.wanted;
    if (here.target === null) panel.say("There is no label here to put a note on.");
    else this.noteForm.open({ note: here.note });
  }

  noted() {
    this.change({ kind: "note", at: this.noteAt, note: this.noteForm.values.note });
    this.noteForm.close();
  }

  newTarget() { this.names.forms.ask(null, []); }

  select(range) {
    this.selection = range;
    this.strips.mark(range);
  }

  // What is shown

  update(plain, expected = this.state.revision) {
    this.state = read(plain, this.about.to_decide, this.state);
    if (plain.revision !== expected) this.overtaken();
    this.seen.keep(this.state.seen);
    this.draw();
  }

  // What was asked for before the newer state was seen was meant for the older one.
  overtaken() {
    const lost = this.queue.forget() ? " What you did last was not done." : "";
    panel.say(`The labels were changed elsewhere. This is the newer state.${lost}`);
  }

  refused(error) {
    this.player.stop();
    if (error.status === 409) {
      this.update(error.state, error.state.revision);
      panel.say("The labels were changed elsewhere. This is the newer state. What you did last was not done.");
    } else if (error.status === 403) panel.say("The server was started anew: open the address that it printed.");
    else panel.say(error.status ? error.message : "The server does not answer: nothing you do now is saved.");
  }

  draw() {
    const { subject, suggestions, shown, about: { subjects, names, frames }, state } = this;
    const here = at(this.track, shown);
    panel.drawPlace(this.stage.scene ? frames[shown] : null, shown, this.total, this.player.speed);
    panel.drawLabel(subject, here);
    panel.drawSubject(subject);
    panel.drawProgress(state);
    panel.drawTools(state, this.stage);
    this.names.draw(subject, here.target);
    this.strips.draw(shown, { ...state, subjects, subject, names, suggestions });
    this.stage.draw(subject, names);
    this.drawing.draw();
  }
}
