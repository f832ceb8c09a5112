// A queue of key presses and clicks: none is lost, and none overtakes one that waits for the labels before it.

export class KeyQueue {
  // moved(): the queue changed; failed(error).
  constructor({ moved, failed }) {
    Object.assign(this, { moved, failed, waiting: 0 });
    this.last = new Promise((open) => { this.open = open; }); // nothing is done before the first frame is shown
  }

  // The promise that run() returns is awaited.
  press(run) {
    this.waiting += 1;
    this.moved();
    this.last = this.last.then(run).catch(this.failed).then(() => { this.waiting -= 1; this.moved(); });
    return this.last;
  }
}
