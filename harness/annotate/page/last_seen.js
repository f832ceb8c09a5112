// The last seen frame of each subject: sent to the server with a delay, so that playing does not send every frame.

export class LastSeen {
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
    clearTimeout(this.timer);
    const { last } = this;
    this.last = this.timer = null;
    if (last) this.send(last);
  }

  // Positions not sent yet are kept when an answer arrives.
  keep(seen) {
    for (const [subject, at] of Object.entries(this.known)) seen[subject] = Math.max(seen[subject], at);
  }

  // The labels were replaced: positions seen before no longer count.
  forget() { this.known = {}; }
}
