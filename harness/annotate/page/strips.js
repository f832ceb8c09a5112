// The strip of the whole clip, and for a long one a second that shows the frames around the one in hand.

import { Strip } from "./strip.js";

const NEAR = 120; // frames: each is wide enough to drag over

export class Strips {
  constructor(handlers) {
    const { length } = handlers.frames;
    const [near, whole] = ["near", "strips"].map((id) => document.getElementById(id));
    this.whole = new Strip(whole, { ...handlers, count: length });
    this.near = length > 2 * NEAR ? new Strip(near, { ...handlers, count: NEAR }) : null;
    near.hidden = !this.near;
  }

  draw(position, what) {
    this.whole.draw(position, what);
    if (this.near) this.near.draw(position, { ...what, subjects: [what.subject] });
  }

  mark(range) {
    this.whole.mark(range);
    if (this.near) this.near.mark(range);
  }
}
