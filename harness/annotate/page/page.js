// The labelling page: the current frame and subject, and the display.

import { Lost, Queue } from "./api.js";
import { Drawing } from "./drawing.js";
import { KeyQueue } from "./key_queue.js";
import { Names } from "./names.js";
import { Navigation } from "./navigation.js";
import * as panel from "./panel.js";
import { Player } from "./player.js";
import { LabelActions } from "./label_actions.js";
import { LastSeen } from "./last_seen.js";
import { Stage } from "./stage.js";
import { Timelines } from "./timelines.js";
import { at, open, read, runs } from "./tracks.js";

const NEAR = 10; // a jump further than this does not count as having seen what lies between

export class Page {
  // first: the answer with labels and drawing.
  constructor(about, first) {
    this.subject = about.subjects[0];
    this.selection = null;
    this.keyQueue = new KeyQueue({ moved: () => this.settle(), failed: (error) => panel.say(error.message) });
    const inTurn = (act) => (...what) => this.keyQueue.press(() => act(...what)); // no click overtakes a key that waits
    this.queue = new Queue({
      revisions: () => ({ revision: this.state.revision, drawn: this.drawing.state.revision }),
      answered: (answer, changes) => this.answered(answer, changes),
      refused: (error) => this.refused(error),
      lost: (error) => this.lost(error),
      moved: () => this.settle(),
    });
    this.lastSeen = new LastSeen((seen) => this.queue.add({ kind: "seen", ...seen }));
    this.labelActions = new LabelActions(this);
    this.navigation = new Navigation(this);
    this.names = new Names({
      look: inTurn((name) => this.choose(name)),
      saved: () => this.saved(),
      changed: (answer) => { panel.say(""); this.renew(answer); },
      failed: (error) => panel.say(error.message),
    });
    this.stage = new Stage({ name: (each) => this.names.of(each), choose: inTurn((...clicked) => this.labelActions.chosen(...clicked)), changed: () => this.go(this.wanted) });
    this.total = about.frames.length;
    this.drawing = new Drawing(this, first.drawn, { press: (run) => this.keyQueue.press(run), look: inTurn((name, at) => this.choose(name, null, at)) });
    this.player = new Player(this, about);
    this.timelines = new Timelines({
      frames: about.frames,
      times: this.player.times,
      advised: about.label_first,
      look: (name) => this.names.className(name),
      select: inTurn((range, subject) => {
        if (subject && subject !== this.subject) this.seek(this.wanted, subject);
        this.select(range);
      }),
      seek: inTurn((position, subject) => this.seek(position, subject || this.subject)),
      stretch: inTurn((position, subject) => { this.seek(position, subject); return this.selectStretch(position); }),
      move: inTurn((at, last, subject) => { this.labelActions.change({ kind: "move", subject, at, last }); }),
    });
    panel.makeSubjects(about.subjects, inTurn((name) => this.navigation.turnTo(name)));
    panel.makeUnlabelled(inTurn(() => this.navigation.toOpen("unlabelled")));
    this.wanted = this.shown = 0;
    this.take(about);
    this.state = read(first.state);
    panel.makePlenty(this.hasRun);
    addEventListener("resize", () => this.go(this.wanted)); // names are as large on every screen
    addEventListener("pagehide", () => { this.drawing.rest(); this.lastSeen.tell(); this.queue.leave(); });
    addEventListener("beforeunload", (event) => { if (this.queue.waiting || this.keyQueue.waiting || this.drawing.waits) event.preventDefault(); });
    addEventListener("focus", () => this.queue.refresh());
  }

  get hasRun() { return this.about.configuration !== null; }
  get track() { return this.state.tracks[this.subject]; }
  get suggestions() { return this.about.suggestions[this.subject]; }

  // The frame that a key refers to: the one on the screen while playing, else the one reached by the last step.
  get here() { return this.player.playing ? this.shown : this.wanted; }

  take(about) {
    this.about = about;
    this.names.set(about);
    panel.drawTitle(about);
    this.drawing.about = about;
  }

  // The targets have changed; after a renaming, so have the labels.
  renew({ about, state, drawn }) {
    this.take(about);
    this.stage.scenes.clear();
    this.drawing.take(drawn);
    this.update(state);
    Promise.resolve(this.showing).then(() => this.go(this.wanted)); // what is being loaded has the names of before
  }

  // The server made these changes; with none of them, it was asked for the present state.
  answered(answer, made) {
    const { state: { revision }, drawing } = this;
    const drawn = drawing.state.revision;
    if (made.some(({ kind }) => kind !== "seen")) panel.say("");
    if (answer.about) this.renew(answer);
    drawing.take(answer.drawn);
    this.update(answer.state);
    if (!made.length && answer.state.revision !== revision) this.overtaken();
    const { kind } = made.at(-1) ?? {};
    const what = answer.about ? "targets" : answer.drawn.revision !== drawn ? "drawing" : "labels";
    if (["undo", "redo"].includes(kind) && what !== (drawing.on ? "drawing" : "labels")) {
      panel.say(`${kind === "undo" ? "Undone" : "Done again"}: the last change of the ${what}.`);
    }
  }

  // Take back, or make again, the last change of labels, targets or drawing.
  undo(kind) {
    this.drawing.rest();
    this.lastSeen.tell();
    this.queue.add({ kind });
  }

  // Position

  // Go to a frame; ``near``: the frames between count as seen if they are few. During playback the player shows it.
  go(position, near = false) {
    this.wanted = Math.min(Math.max(position, 0), this.total - 1);
    if (near && this.wanted <= this.state.seen[this.subject] + NEAR) this.see(this.wanted);
    this.settle();
    if (this.player.playing) return this.showing;
    this.showing ??= this.show().finally(() => { this.showing = null; this.settle(); });
    return this.showing;
  }

  // Load the newest requested frame, one at a time: frames passed meanwhile are not loaded.
  async show() {
    let wanted;
    do {
      wanted = this.wanted;
      try {
        const found = await this.stage.load(wanted);
        if (this.player.playing) return;
        this.put(wanted, found);
        this.keyQueue.open();
      } catch (error) {
        panel.say(error.message || `frame ${this.about.frames[wanted]} cannot be shown`);
        if (error instanceof Lost) setTimeout(() => this.go(this.wanted), 500);
        else this.keyQueue.open();
        if (this.wanted === wanted) break;
      }
    } while (this.wanted !== wanted);
    this.stage.ahead(wanted, 6, this.total);
  }

  // A frame whose time has come while it plays.
  present(position, found) {
    this.wanted = position;
    this.put(position, found);
    this.settle();
  }

  put(position, [image, scene]) {
    this.shown = position;
    document.body.dataset.frame = this.about.frames[position];
    this.stage.show(image, scene, position, this.subject);
    this.draw();
  }

  // Whether everything requested is shown, and every change is saved.
  settle() {
    const waits = this.wanted !== this.shown || this.showing || this.queue.waiting > 0 || this.lastSeen.waits || this.keyQueue.waiting > 0 || this.drawing?.waits || this.player?.film.waits;
    document.body.setAttribute("aria-busy", Boolean(waits));
  }

  // Wait until all earlier changes are answered.
  saved() { return this.queue.running ?? Promise.resolve(); }

  // A target's key or button, or a click on it: the target to find, or what the subject looks at.
  choose(name, ...where) {
    if (this.navigation.finding) return this.navigation.find(name);
    this.labelActions.look(name, ...where);
  }

  // The frames around a position with the same label, as the range.
  async selectStretch(position = this.here) {
    if (!this.player.playing) await this.saved();
    const { first, last } = at(runs(this.track), position);
    this.select([first, last]);
  }

  seek(position, subject) {
    this.lastSeen.tell();
    if (subject !== this.subject) this.navigation.restart();
    this.subject = subject;
    this.select(null);
    if (position === null) return;
    this.go(position);
    if (this.player.playing) this.player.jump(this.wanted);
  }

  beside(view) { this.stage.beside = this.stage.beside === view ? null : view; this.go(this.wanted); }
  head() { this.stage.zoomed = !this.stage.zoomed; this.go(this.wanted); }
  faster(by) { this.player.faster(by); this.draw(); }
  shuttle(direction) { this.player.shuttle(direction); this.draw(); }

  // Frames between two positions count as seen if they adjoin the frames seen before.
  pass(from, to) {
    if (to > from && from <= this.state.seen[this.subject] + NEAR) this.see(to);
  }

  see(position) {
    const { seen } = this.state;
    if (position <= seen[this.subject]) return;
    seen[this.subject] = position;
    this.lastSeen.note(this.subject, position, this.player.playing);
  }

  select(range) {
    this.selection = range;
    this.timelines.mark(range);
    panel.drawRange(range && range.map((position) => this.about.frames[position]));
  }

  // Let go of the range and of a search.
  escape() {
    this.navigation.endFinding();
    this.select(null);
    this.draw();
  }

  // Begin or end a range here.
  bound(isEnd) {
    const other = this.selection ? this.selection[isEnd ? 0 : 1] : this.here;
    this.select([Math.min(other, this.here), Math.max(other, this.here)]);
  }

  zoomTimeline(by) {
    this.timelines.zoom(by);
    this.draw();
  }

  loop() {
    this.player.loop = this.player.loop ? null : this.selection;
    panel.say(this.player.loop || this.selection ? "" : "Choose a range first: drag on the timeline, or press b and e.");
    this.draw();
  }

  // Display

  update(plain) {
    this.state = read(plain, this.state);
    this.lastSeen.keep(this.state.seen);
    this.draw();
  }

  // Actions requested before the newer state was shown were meant for the older one.
  overtaken() {
    this.lastSeen.forget();
    const lost = this.queue.forget() ? " Your last change was not made." : "";
    panel.say(`The labels were changed elsewhere. This is the newer state.${lost}`);
  }

  refused(error) {
    this.player.stop();
    const { status, message, body = {} } = error;
    if (status === 409) this.lastSeen.forget();
    if (body.about) this.take(body.about);
    if (body.state) {
      this.drawing.take(body.drawn);
      this.update(body.state);
    }
    panel.say(status === 409 ? "The labels or the drawing were changed elsewhere. This is the newer state. Your last change was not made." : message);
  }

  lost(error) {
    if (error) {
      this.player.stop();
      panel.say(`${error.message[0].toUpperCase()}${error.message.slice(1)}. What you do is kept here and saved when it answers: start vfoa annotate again, and leave this page open.`);
    } else {
      panel.say("");
      this.go(this.wanted);
    }
  }

  draw() {
    const { subject, suggestions, shown, player, about: { subjects, names, frames }, state } = this;
    const here = at(this.track, shown);
    const said = `${subject}: ${here.target ?? "not labelled"}`;
    panel.drawPlace(this.stage.scene ? frames[shown] : null, shown, this.total, player);
    panel.drawLabel(subject, here);
    panel.drawSubject(subject);
    panel.drawProgress(state);
    panel.drawUnlabelled([subject, ...subjects.filter((name) => name !== subject)].map((name) => [name, open(state.tracks[name], state.seen[name])]));
    panel.drawTools(this);
    this.names.draw(subject, here.target);
    this.timelines.draw(shown, { ...state, subjects, subject, names, suggestions, loop: player.loop, said });
    this.stage.draw(subject, names);
    this.drawing.draw();
  }
}
