// The timeline of the whole clip, and above it an enlarged one, for a long clip or when zoomed.

import { Timeline } from "./timeline.js";

const NEAR = 120; // frames: each is wide enough to drag over
const NEAREST = 15;

export class Timelines {
  constructor(handlers) {
    this.total = handlers.frames.length;
    [this.nearRoot, this.wholeRoot] = ["near", "timelines"].map((id) => document.getElementById(id));
    this.whole = new Timeline(this.wholeRoot, { ...handlers, count: this.total });
    this.near = new Timeline(this.nearRoot, { ...handlers, count: this.total > 2 * NEAR ? NEAR : this.total });
  }

  // Zoom in or out by a factor of two.
  zoom(by) {
    this.near.count = Math.min(Math.max(Math.round(this.near.count / by), Math.min(NEAREST, this.total)), this.total);
  }

  draw(position, what) {
    const isNear = this.near.count < this.total;
    this.nearRoot.hidden = !isNear;
    if (isNear) this.near.draw(position, { ...what, subjects: [what.subject] });
    this.whole.draw(position, what);
  }

  mark(range) {
    this.whole.mark(range);
    this.near.mark(range);
  }
}
