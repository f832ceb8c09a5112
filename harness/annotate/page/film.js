// Pictures while the clip plays: asked for before their time comes, shown when it has come, left out when too late.

const AT_ONCE = 2; // more would wait for each other, and the server would read the clip out of order
const MOST = 12; // waiting for their time
const SLACK_S = .06; // asked for that much before the time that they usually need
const SCREEN_S = 1 / 60; // from drawing to the screen
const STALL_MS = 1500;
const LONGEST_S = 1; // a picture that took longer was an exception

export class Film {
  // load(position): a promise of what is shown; show(position, found); failed(position, error); moved(): one was asked
  // for, or came.
  constructor({ load, show, failed, moved }) {
    Object.assign(this, { load, show, failed, moved, needS: 0, spreadS: 0 });
    this.clear();
  }

  // Whether pictures are on their way.
  get waits() { return this.run.pending.size > 0; }

  // Nothing that was asked for before is shown any more; the next one is ``position``.
  clear(position = 0, direction = 1) {
    this.run = { pending: new Map(), found: [] };
    Object.assign(this, { direction, next: position });
  }

  // Whether a picture takes so long that the clock has to wait for it.
  get isLate() {
    const [since] = this.run.pending.values();
    return since !== undefined && performance.now() - since > STALL_MS;
  }

  // positionAt(seconds): where the clip is, or was, that long after now.
  tick(positionAt) {
    const due = positionAt(SCREEN_S);
    this.present(due);
    const { run, direction } = this;
    const isBefore = (one, other) => direction * (other - one) > 0;
    // what would come too late is left out, unless nothing else comes
    const soonest = run.pending.size + run.found.length ? positionAt(this.needS) : due;
    if (isBefore(this.next, soonest)) this.next = soonest;
    const target = positionAt(this.needS + 2 * this.spreadS + SLACK_S);
    while (run.pending.size < AT_ONCE && run.pending.size + run.found.length < MOST && !isBefore(target, this.next)) {
      this.ask(this.next);
      this.next += direction;
    }
  }

  async ask(position) {
    const { run } = this;
    const since = performance.now();
    run.pending.set(position, since);
    this.moved();
    try {
      const found = await this.load(position);
      this.learn(Math.min((performance.now() - since) / 1000, LONGEST_S));
      run.found.push([position, found]);
    } catch (error) {
      if (run === this.run) this.failed(position, error);
    }
    run.pending.delete(position);
    this.moved();
  }

  // How long a picture needs, and how much that varies, over the last few.
  learn(seconds) {
    this.spreadS += .2 * (Math.abs(seconds - this.needS) - this.spreadS);
    this.needS += .2 * (seconds - this.needS);
  }

  // The newest whose time has come; those before it are left out.
  present(due) {
    const { run, direction } = this;
    const isDue = ([position]) => direction * (due - position) >= 0;
    const newest = run.found.filter(isDue).sort(([one], [other]) => direction * (one - other)).pop();
    if (!newest) return;
    run.found = run.found.filter((each) => !isDue(each));
    this.show(...newest);
  }

  // The newest there is, whether its time has come or not.
  showNewest() { this.present(this.direction * Infinity); }
}
