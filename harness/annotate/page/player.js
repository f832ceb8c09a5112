// Playing by the clock: shows the frame of the current time; frames that cannot be drawn in time are skipped.

import { Lost } from "./api.js";
import { Film } from "./film.js";
import * as panel from "./panel.js";

const USUAL_HZ = 10; // where the source does not know its rate
const SLOWEST = 1 / 16;
const FASTEST = 8;

// The time in the clip while it plays.
class Clock {
  start(timeS, speed) { Object.assign(this, { timeS, speed, since: performance.now() }); }
  now() { return this.timeS + (performance.now() - this.since) / 1000 * this.speed; }
}

export class Player {
  constructor(page, about) {
    this.page = page;
    const isTimed = about.rate_hz !== null;
    this.times = isTimed ? about.times_s : about.frames.map((_, place) => place / USUAL_HZ);
    this.stepS = 1 / (about.rate_hz || USUAL_HZ);
    this.speed = Number(localStorage.getItem("speed")) || 1;
    this.direction = 1;
    this.clock = new Clock();
    this.run = null;
    this.loop = null; // [first, last]
    this.film = new Film({
      load: (position) => page.stage.load(position),
      show: (position, found) => {
        page.pass(this.from, position);
        this.from = position;
        page.present(position, found);
      },
      failed: (position, error) => this.failed(position, error),
      moved: () => page.settle(),
    });
  }

  get playing() { return this.run !== null; }

  toggle() { if (this.playing) this.stop(); else this.start(); }

  // The picture on the screen stays.
  stop() {
    if (!this.playing) return;
    this.end();
    this.page.go(this.page.wanted);
  }

  end() {
    this.run = null;
    this.film.clear();
    document.body.classList.remove("playing");
  }

  faster(by) {
    this.speed = Math.min(Math.max(this.speed * by, SLOWEST), FASTEST);
    localStorage.setItem("speed", this.speed);
    if (this.playing) this.anchor(this.clock.now());
  }

  // J and L: play in that direction; pressed again, twice as fast.
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
    this.jump(page.wanted);
    document.body.classList.add("playing");
    const run = this.run = {};
    const next = () => {
      if (this.run !== run) return;
      this.tick();
      setTimeout(next, 8);
    };
    next();
  }

  anchor(timeS) {
    this.isStalled = false;
    this.clock.start(timeS, this.direction * this.speed);
    this.film.clear(this.positionAt(timeS), this.direction);
  }

  tick() {
    const { page, times, loop, direction, film } = this;
    if (this.stalls()) return;
    const time = this.clock.now();
    const [first, last] = loop || [0, page.total - 1];
    if (direction > 0 && time >= times[last] + this.stepS) {
      if (!loop) return this.finish(last);
      this.jump(first);
    } else if (direction < 0 && time < times[first]) {
      if (!loop) return this.finish(first);
      this.jump(last);
    } else {
      const at = (seconds) => this.positionAt(time + direction * this.speed * seconds);
      film.tick((seconds) => Math.min(Math.max(at(seconds), first), last));
    }
  }

  // Whether the clock waits for a picture, as a film that is not there yet; it goes on from the one that came.
  stalls() {
    const { isLate } = this.film;
    if (this.isStalled && !isLate) {
      this.film.showNewest();
      this.anchor(this.times[this.page.shown]);
    }
    this.isStalled = isLate;
    return isLate;
  }

  // What lies between here and there is not seen by that.
  jump(position) {
    this.page.wanted = this.from = position;
    this.anchor(this.times[position]);
  }

  failed(position, error) {
    if (error instanceof Lost) {
      this.stop();
      this.page.go(position);
    } else panel.say(error.message || `frame ${this.page.about.frames[position]} cannot be shown`);
  }

  finish(position) {
    this.end();
    this.page.pass(this.from, position);
    this.page.go(position);
  }

  // The last frame at or before this time.
  positionAt(timeS) {
    let [low, high] = [0, this.times.length - 1];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.times[middle] <= timeS + 1e-6) low = middle; else high = middle - 1;
    }
    return low;
  }
}
