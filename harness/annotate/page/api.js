// Requests to the server, and the queue of changes.

const PAUSE_MS = 500; // between two tries while the server does not answer
const MOST = 200; // changes in a request
const ROOM = 60_000; // characters that a browser sends after a page is closed

export class Refused extends Error {
  constructor(status, body) {
    super(body.error || `the server answered ${status}`);
    Object.assign(this, { status, body });
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

// Changes that wait are sent together, in their order. While the server does not answer, they are kept and sent again; by
// their ids none is made twice. When one is refused, those behind it are dropped: they were meant for a state that no
// longer exists.
export class Queue {
  // revisions(): of the state that is shown; answered(answer, changes): they were made; refused(error): one was refused;
  // lost(error or null): the server stopped or resumed answering; moved(): the queue changed.
  constructor({ revisions, answered, refused, lost, moved }) {
    Object.assign(this, { revisions, answered, refused, lost, moved, isLost: false, pending: [], sending: [], isAsked: false });
    this.running = null;
  }

  get waiting() { return this.pending.length + this.sending.length + (this.running ? 1 : 0); }

  // Resolved when nothing waits any more.
  add(change) {
    this.pending.push({ id: crypto.randomUUID(), ...change });
    return this.run();
  }

  // Ask for the present state.
  refresh() {
    this.isAsked = true;
    return this.run();
  }

  run() {
    this.running ??= this.pump().finally(() => { this.running = null; this.moved(); });
    this.moved();
    return this.running;
  }

  async pump() {
    await null; // what one press adds goes together
    while (this.pending.length || this.isAsked) {
      this.sending = this.pending.splice(0, MOST);
      this.isAsked = false;
      try {
        this.answered(await this.insist({ ...this.revisions(), changes: this.sending }), this.sending);
      } catch (error) {
        this.forget();
        this.refused(error);
      }
      this.sending = [];
      this.moved();
    }
  }

  // Drop the changes that are not sent yet; return whether there were any.
  forget() { return this.pending.splice(0).length > 0; }

  // The page is closing: all that waits is sent at once, and no answer is awaited.
  leave() {
    let room = ROOM;
    const changes = [...this.sending, ...this.pending].filter((each) => { room -= JSON.stringify(each).length + 1; return room > 0; });
    if (changes.length) post("/api/change", { ...this.revisions(), changes }, true).catch(() => {});
  }

  async insist(body) {
    for (;;) {
      try {
        const answer = await (body.changes.length ? post("/api/change", body) : get(`/api/state?revision=${body.revision}`));
        this.tell(null);
        return answer;
      } catch (error) {
        this.tell(error instanceof Lost ? error : null);
        if (!this.isLost) throw error;
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
