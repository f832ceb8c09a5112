// Ways to other frames and subjects: by steps, changes of the label, open frames, a target's stretches, suggestions.

import * as panel from "./panel.js";
import { at, changes, open, runs } from "./tracks.js";

const SAID = {
  unlabelled: "Every frame of every subject has a label.",
  undecided: "No suggestion is undecided.",
  "label first": "All frames to label first have a label.",
};

export class Navigation {
  constructor(page) {
    this.page = page;
    this.finding = 0; // the next stretch (1) or the one before (-1) of the target whose key comes next
    this.found = null; // the last target that was found
    this.rank = -1; // of the last frame by how unsure the run was
  }

  get order() { return this.page.about.order && this.page.about.order[this.page.subject]; }

  step(by) {
    const { page } = this;
    page.player.stop();
    if (page.about.uncertain_first) return this.unsure(by);
    const from = page.wanted;
    page.go(from + by);
    page.pass(from, page.wanted);
  }

  async toChange(direction) {
    const { page } = this;
    await this.settled();
    const all = changes(page.track, page.suggestions);
    const next = direction > 0 ? all.find((each) => each > page.wanted) : all.findLast((each) => each < page.wanted);
    page.go(next ?? (direction > 0 ? page.total - 1 : 0), true);
  }

  // Go to the next frames that are unlabelled, undecided (a suggestion), or to label first: these become
  // the range, so that a label ends with them. After the last, to the first. When the subject has none, to those of the
  // next subject.
  async toOpen(kind) {
    const { page } = this;
    await this.settled();
    const { subjects } = page.about;
    const place = subjects.indexOf(page.subject);
    const subject = [...subjects.slice(place), ...subjects.slice(0, place)].find((name) => this.openOf(name, kind).length);
    if (!subject) return panel.say(SAID[kind]);
    const all = this.openOf(subject, kind);
    const next = (subject === page.subject && all.find((each) => each.first > page.wanted)) || all[0];
    if (subject !== page.subject) page.seek(null, subject);
    page.go(next.first, kind !== "label first");
    if (kind === "label first") page.select([next.first, next.last]);
  }

  openOf(subject, kind) {
    const { state, about } = this.page;
    const found = open(state.tracks[subject], state.seen[subject]);
    if (kind !== "label first") return found.filter((each) => each.kind === kind);
    const isOpen = ({ first, last }) => found.some((each) => each.first <= last && each.last >= first);
    return about.label_first.filter((each) => each.subject === subject && isOpen(each));
  }

  // The next target's key finds the target's next stretch (by > 0) or the one before; pressed twice, the last one again.
  startFinding(by) {
    const isAgain = this.finding === by;
    this.finding = by;
    if (isAgain) return this.find(this.found);
    panel.say(`Find the ${by > 0 ? "next" : "previous"} stretch of: press a target's key${this.found ? `, or again for ${this.found}` : ""}.`);
    this.page.draw();
  }

  endFinding() {
    if (this.finding) panel.say("");
    this.finding = 0;
  }

  // Without a name, that of the label here.
  async find(asked) {
    const { page, finding: by } = this;
    this.finding = 0;
    await this.settled();
    const name = asked ?? at(page.track, page.wanted).target;
    this.found = name ?? this.found;
    const all = runs(page.track).filter((each) => each.target === name);
    const next = by > 0 ? all.find((each) => each.first > page.wanted) ?? all[0]
      : all.findLast((each) => each.last < page.wanted) ?? all.at(-1);
    panel.say(next ? "" : `${page.subject} never looks at ${name ?? "anything"}.`);
    if (next) page.go(next.first);
    page.draw();
  }

  // Step through the suggestions, the most uncertain first; after the last, begin again.
  unsure(by) {
    const { page } = this;
    page.player.stop();
    const order = page.about.uncertain_first ? this.order : this.order.filter((each) => page.suggestions[each]);
    if (!order.length) return panel.say(`The run suggests nothing for ${page.subject}.`);
    if (this.rank < 0 && by < 0) this.rank = 0;
    this.rank = (this.rank + by + order.length) % order.length;
    page.go(order[this.rank]);
  }

  // Begin with the most uncertain suggestion of another subject.
  restart() { this.rank = this.page.about.uncertain_first ? 0 : -1; }

  nextSubject(by) {
    const { subject, about: { subjects } } = this.page;
    return this.turnTo(subjects[(subjects.indexOf(subject) + by + subjects.length) % subjects.length]);
  }

  async turnTo(subject) {
    const { page } = this;
    page.seek(null, subject);
    if (page.player.playing) return page.draw(); // it plays on
    await page.saved();
    page.go(this.start(), true);
  }

  // The frame at which labelling of a subject continues: the first that is not labelled or confirmed.
  start() {
    const { page } = this;
    if (page.about.uncertain_first) return this.order[this.rank = 0];
    const seen = page.state.seen[page.subject];
    const isOpen = (each) => each.target === null || each.suggested || (each.carried && each.last > seen);
    const first = page.track.find(isOpen);
    if (!first) return 0;
    return first.carried ? Math.max(first.first, seen) : first.first;
  }

  // Stop playing, and wait until all earlier changes are answered.
  settled() {
    this.page.player.stop();
    return this.page.saved();
  }
}
