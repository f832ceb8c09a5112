// The labelling page: where it is in the clip, who is labelled, and what a key or a click does.

import { Queue, get, post } from "./api.js";
import { bind } from "./keys.js";
import { Names } from "./names.js";
import { drawLabel, drawPlace, drawProgress, drawSubjects } from "./panel.js";
import { Player } from "./player.js";
import { Stage } from "./stage.js";
import { Strip } from "./strip.js";
import { at, changes, read, runs } from "./tracks.js";

const NEAR = 10; // a jump further than this does not count as having seen what lies between
const find = (id) => document.getElementById(id);

class Page {
  constructor(about, state) {
    this.subject = about.subjects[0];
    this.selection = null;
    this.queue = new Queue({ refused: (error) => this.refused(error), moved: () => this.settle() });
    this.names = new Names({
      look: (name) => this.look(name), changed: (next) => this.renew(next), failed: (error) => this.say(error.message),
    });
    this.stage = new Stage({ name: (each) => this.named(each), choose: (each, point) => this.chosen(each, point) });
    this.total = about.frames.length;
    this.strip = new Strip(find("strips"), {
      total: this.total,
      look: (name) => this.names.className(name),
      select: (range) => this.select(range),
      seek: (position, subject) => { if (subject) this.subject = subject; this.go(position); },
    });
    this.player = new Player(this, about.rate_hz);
    this.wanted = this.shown = 0;
    this.state = read(state);
    this.take(about);
    find("note").addEventListener("submit", (event) => { event.preventDefault(); this.setNote(); });
    find("note").querySelector('[value="cancel"]').addEventListener("click", () => { find("note").hidden = true; });
    find("plenty").hidden = !this.hasRun;
    find("plenty").addEventListener("input", (event) => { find("plenty").lastElementChild.value = event.target.value; });
    addEventListener("pagehide", () => this.tellSeen(true));
    addEventListener("focus", () => this.queue.add(async () => this.update(await get("/api/state"))));
  }

  get hasRun() { return this.about.configuration !== null; }
  get track() { return this.state.tracks[this.subject]; }
  get suggestions() { return this.about.suggestions[this.subject]; }
  get order() { return this.about.order && this.about.order[this.subject]; }

  take(about) {
    this.about = about;
    this.names.set(about.names);
    find("title").textContent = about.file;
    document.title = `${about.file} – vfoa annotate`;
  }

  renew(about) {
    this.take(about);
    this.stage.scenes.clear();
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
      this.stage.show(image, scene, wanted, this.subject);
      this.see(wanted, near);
      this.draw();
      this.stage.ahead(wanted, 6, this.total);
    } catch (error) { this.say(error.message || `frame ${this.about.frames[wanted]} cannot be shown`); }
    this.settle();
  }

  // Whether all that was asked for is shown, and all that was said is saved.
  settle() {
    document.body.setAttribute("aria-busy", this.wanted !== this.shown || this.queue.waiting > 0 || !!this.unsaid);
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
    this.tellSeen();
    this.subject = subject;
    this.select(null);
    return this.go(this.start(), true);
  }

  // Where a subject's work goes on: the first frame that is not labelled, or not confirmed.
  start() {
    if (this.about.uncertain_first) return this.order[0];
    const seen = this.state.seen[this.subject];
    const open = this.track.find((each) => each.target === null || each.suggested || (each.carried && each.last > seen));
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
    this.unsaid = { subject: this.subject, at: position };
    if (!this.timer) this.timer = setTimeout(() => this.tellSeen(), this.player.playing ? 600 : 250);
  }

  tellSeen(leaving = false) {
    clearTimeout(this.timer);
    this.timer = null;
    const seen = this.unsaid;
    this.unsaid = null;
    if (!seen) return;
    if (leaving) post("/api/seen", seen, true).catch(() => {});
    else this.queue.add(async () => this.update(await post("/api/seen", seen)));
  }

  // What is said

  change(what) {
    const seen = this.unsaid && this.unsaid.subject === this.subject;
    if (seen) this.tellSeen();
    return this.queue.add(async () => {
      const state = await post("/api/change", { revision: this.state.revision, subject: this.subject, ...what });
      this.say("");
      this.update(state, state.revision);
    });
  }

  look(target, point_px = null) {
    if (target === this.subject) return;
    const here = this.player.playing ? this.shown : this.wanted;
    if (this.selection) {
      const [first, last] = this.selection;
      this.select(null);
      this.change({ kind: "range", at: first, last, target });
    } else if (this.about.uncertain_first) this.change({ kind: "range", at: here, last: here, target });
    else this.change({ kind: "look", at: here, target, point_px });
  }

  chosen(object, point) {
    if (!this.names.names.includes(object.name)) this.names.ask(object, this.stage.scene.objects);
    else this.look(object.name, this.about.shared.includes(object.name) ? point : null);
  }

  clear() {
    const [first, last] = this.selection || [this.wanted, at(runs(this.track), this.wanted).last];
    this.select(null);
    this.change({ kind: "range", at: first, last, target: null });
  }

  nudge(by) {
    const all = runs(this.track);
    const place = all.findIndex((each) => each.first <= this.wanted && this.wanted <= each.last);
    if (place < 1 || all[place].suggested || all[place - 1].suggested) return;
    const [before, here] = [all[place - 1], all[place]];
    if (by < 0 && before.first < here.first) this.change({ kind: "range", at: here.first - 1, last: here.first - 1, target: here.target });
    if (by > 0 && here.first < here.last) {
      this.change({ kind: "range", at: here.first, last: here.first, target: before.target });
      if (this.wanted === here.first) this.go(this.wanted + 1, true);
    }
  }

  accept() { if (this.suggestions) this.change({ kind: "accept", attention: Number(find("plenty").firstElementChild.value) }); }

  async confirm() {
    await this.change({ kind: "confirm", at: this.wanted });
    const next = this.track.find((each) => each.suggested && each.first > this.wanted) || this.track.find((each) => each.suggested);
    if (next) this.go(next.first, true);
  }

  note() {
    const here = at(this.track, this.wanted);
    if (here.target === null) return this.say("there is no label here to put a note on");
    find("note").hidden = false;
    find("note").elements.note.value = here.note || "";
    return find("note").elements.note.focus();
  }

  setNote() {
    this.change({ kind: "note", at: this.wanted, note: find("note").elements.note.value.trim() });
    find("note").hidden = true;
    document.activeElement.blur();
  }

  newTarget() { this.names.ask(null, []); }

  select(range) {
    this.selection = range;
    this.strip.mark(range);
  }

  // What is shown

  update(plain, expected = this.state.revision) {
    this.state = read(plain);
    if (plain.revision !== expected) this.overtaken();
    // What was seen but not yet told is not forgotten.
    if (this.unsaid) this.state.seen[this.unsaid.subject] = Math.max(this.state.seen[this.unsaid.subject], this.unsaid.at);
    this.draw();
  }

  // What was asked for before the newer state was seen was meant for the older one.
  overtaken() {
    const lost = this.queue.forget() ? " What you did last was not done." : "";
    this.say(`The labels were changed elsewhere. This is the newer state.${lost}`);
  }

  refused(error) {
    this.player.stop();
    if (error.status === 409) {
      this.update(error.state, error.state.revision);
      this.say("The labels were changed elsewhere. This is the newer state. What you did last was not done.");
    } else if (error.status === 403) this.say("The server was started anew: open the address that it printed.");
    else this.say(error.status ? error.message : "The server does not answer: nothing you do now is saved.");
  }

  say(text) {
    find("notice").textContent = text;
    find("notice").hidden = !text;
  }

  named(object) {
    const known = this.names.names.includes(object.name);
    const key = known ? this.names.key(object.name) : "+";
    return { text: `${key} ${object.name}`, className: known ? this.names.className(object.name) : "unnamed" };
  }

  draw() {
    if (!this.stage.scene) return;
    const here = at(this.track, this.shown);
    document.body.dataset.frame = this.about.frames[this.shown];
    document.body.dataset.revision = this.state.revision;
    drawPlace(this.about.frames[this.shown], this.shown, this.total, this.player.speed);
    drawLabel(this.subject, here);
    this.names.draw(this.subject, here.target);
    this.strip.draw({
      subjects: this.about.subjects, subject: this.subject, tracks: this.state.tracks,
      seen: this.state.seen, suggestions: this.suggestions,
    });
    this.strip.point(this.shown);
    drawSubjects(this.about.subjects, this.subject, (name) => this.turnTo(name));
    drawProgress(this.state);
    this.stage.draw(this.stage.scene, this.subject);
    for (const [id, can] of [["undo", this.state.can_undo], ["redo", this.state.can_redo]]) find(`do-${id}`).disabled = !can;
  }
}

const [about, state] = await Promise.all([get("/api/clip"), get("/api/state")]);
const page = new Page(about, state);
bind(page, page.names);
await page.go(page.start(), true);
