// Playing by the clock: the frame of the time is shown, and what the computer is too slow for is left out.

import { SystemClock } from "./clock.js";

const USUAL_HZ = 10; // where the source does not know its rate
const SLOWEST = 1 / 16;
const FASTEST = 8;
const STALL_MS = 1500; // the clock waits for a frame that takes longer

export class Player {
  constructor(page, about) {
    this.page = page;
    const isTimed = about.rate_hz !== null;
    this.times = isTimed ? about.times_s : about.frames.map((_, place) => place / USUAL_HZ);
    this.stepS = 1 / (about.rate_hz || USUAL_HZ);
    this.speed = .5;
    this.direction = 1;
    this.clock = new SystemClock();
    this.run = null;
    this.loop = null; // [first, last]
  }

  get playing() { return this.run !== null; }

  toggle() { if (this.playing) this.stop(); else this.start(); }

  // What is on the screen stays there.
  stop() {
    if (this.playing) this.page.go(this.page.shown);
    this.end();
  }

  end() {
    this.run = null;
    this.clock.stop();
    document.body.classList.remove("playing");
  }

  faster(by) {
    this.speed = Math.min(Math.max(this.speed * by, SLOWEST), FASTEST);
    if (this.playing) this.anchor(this.clock.now());
  }

  // J and L: play that way; once more, twice as fast.
  shuttle(direction) {
    if (!this.playing || this.direction !== direction) {
      this.speed = Math.max(this.speed, 1);
      this.start(direction);
    } else this.faster(2);
  }

  start(direction = 1) {
    const { page, times, loop } = this;
    this.direction = direction;
    const end = direction > 0 ? page.total - 1 : 0;
    if (loop && (page.wanted < loop[0] || page.wanted > loop[1])) page.go(loop[0]);
    else if (page.wanted === end && direction > 0) page.go(0);
    this.anchor(times[page.wanted]);
    document.body.classList.add("playing");
    const run = this.run = {};
    const next = () => {
      if (this.run !== run) return;
      this.tick();
      setTimeout(next, 8);
    };
    next();
  }

  anchor(timeS) { this.clock.start(timeS, this.direction * this.speed); }

  tick() {
    const { page, times, loop, direction } = this;
    if (page.loadingForMs > STALL_MS) { // as a film that is not there yet
      this.anchor(times[page.shown]);
      return;
    }
    const time = this.clock.now();
    const soon = time + this.direction * this.speed * page.leadS; // a picture takes that long to come
    const [first, last] = loop || [0, page.total - 1];
    if (direction > 0 && time >= times[last] + this.stepS) {
      if (!loop) return this.finish(last);
      page.go(first);
      this.anchor(times[first]);
    } else if (direction < 0 && time < times[first]) {
      if (!loop) return this.finish(first);
      page.go(last);
      this.anchor(times[last]);
    } else page.playTo(Math.min(Math.max(this.positionAt(soon), first), last));
  }

  finish(position) {
    this.page.playTo(position);
    this.page.pass(this.page.playedFrom, position);
    this.end();
  }

  // The last frame that was taken by then.
  positionAt(timeS) {
    let [low, high] = [0, this.times.length - 1];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.times[middle] <= timeS + 1e-6) low = middle; else high = middle - 1;
    }
    return low;
  }
}
