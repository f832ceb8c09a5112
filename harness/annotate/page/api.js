// Talking to the server. Changes wait for each other, so that each is made on the state the one before has left.

export class Refused extends Error {
  constructor(status, body) {
    super(body.error || `the server answered ${status}`);
    this.status = status;
    this.state = body.state;
  }
}

async function answer(response) {
  if (response.ok) return response.json();
  const text = await response.text();
  let body;
  try { body = JSON.parse(text); } catch { body = { error: text }; }
  throw new Refused(response.status, body);
}

export const get = async (path) => answer(await fetch(path));

export const post = async (path, body, keepalive = false) =>
  answer(await fetch(path, {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), keepalive,
  }));

// One after the other. When one is refused, those that were already waiting were meant for a state that is gone.
export class Queue {
  // refused(error): one was refused; moved(): one came or went.
  constructor({ refused, moved }) {
    Object.assign(this, { refused, moved });
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

  // Drop what is waiting behind the work in hand; whether there was any.
  forget() {
    this.age += 1;
    return this.waiting > 1;
  }

  async do(work, age) {
    try {
      if (age === this.age) await work();
    } catch (error) {
      this.forget();
      this.refused(error);
    }
    this.waiting -= 1;
    this.moved();
  }
}
