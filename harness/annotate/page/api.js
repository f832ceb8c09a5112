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
  constructor(refused) {
    this.refused = refused;
    this.last = Promise.resolve();
    this.age = 0;
  }

  add(work) {
    const age = this.age;
    this.last = this.last.then(async () => {
      if (age !== this.age) return;
      try { await work(); } catch (error) { this.age += 1; this.refused(error); }
    });
    return this.last;
  }
}
