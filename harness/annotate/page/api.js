// Requests to the server. Changes are sent one after the other, so that each is made on the result of the one before.

const PAUSE_MS = 500; // between two tries while the server does not answer

export class Refused extends Error {
  constructor(status, body) {
    super(body.error || `the server answered ${status}`);
    this.status = status;
    this.state = body.state;
  }
}

// No server answers, or one that was started anew.
export class Lost extends Error {}

async function ask(path, options) {
  let response;
  let text;
  try {
    response = await fetch(path, options);
    text = await response.text();
  } catch { throw new Lost("the server does not answer"); }
  if (response.status === 403) throw new Lost("the server was started anew");
  let body;
  try { body = JSON.parse(text); } catch { body = { error: text }; }
  if (!response.ok) throw new Refused(response.status, body);
  return body;
}

export const get = (path) => ask(path);

export const post = (path, body, keepalive = false) => ask(path, {
  method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), keepalive,
});

// A queue of changes. While the server does not answer, all are kept and retried. When one is refused, those waiting
// behind it are dropped: they were meant for a state that no longer exists.
export class Queue {
  // refused(error): one was refused; lost(error or null): the server stopped or resumed answering; moved(): the queue changed.
  constructor({ refused, lost, moved }) {
    Object.assign(this, { refused, lost, moved, isLost: false });
    this.last = Promise.resolve();
    this.age = 0;
    this.waiting = 0;
  }

  add(work) {
    const age = this.age;
    this.waiting += 1;
    this.moved();
    this.last = this.last.then(() => this.do(work, age));
    return this.last;
  }

  // Drop the changes that wait behind the current one; return whether there were any.
  forget() {
    this.age += 1;
    return this.waiting > 1;
  }

  async do(work, age) {
    try {
      if (age === this.age) await this.insist(work);
    } catch (error) {
      this.forget();
      this.refused(error);
    }
    this.waiting -= 1;
    this.moved();
  }

  async insist(work) {
    for (;;) {
      try {
        await work();
        this.tell(null);
        return;
      } catch (error) {
        if (!(error instanceof Lost)) throw error;
        this.tell(error);
        await new Promise((over) => { setTimeout(over, PAUSE_MS); });
      }
    }
  }

  tell(error) {
    if (!error && !this.isLost) return;
    this.isLost = error !== null;
    this.lost(error);
  }
}
