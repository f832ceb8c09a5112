// A cache of loaded pictures by address; the oldest is removed. A picture is decoded before it is shown.

import { Lost, Refused } from "./api.js";

export class Kept {
  constructor(load, most, drop = () => {}) { Object.assign(this, { load, most, drop, found: new Map() }); }

  get(key) {
    const known = this.found.get(key) || this.load(key);
    this.found.delete(key);
    this.found.set(key, known);
    known.catch(() => { if (this.found.get(key) === known) this.found.delete(key); });
    if (this.found.size > this.most) this.forget(this.found.keys().next().value);
    return known;
  }

  forget(key) {
    const known = this.found.get(key);
    this.found.delete(key);
    known.then(this.drop, () => {});
  }

  clear() { for (const key of [...this.found.keys()]) this.forget(key); }
}

export async function loadPicture(path) {
  let answer;
  try { answer = await fetch(path); } catch { throw new Lost("the server does not answer"); }
  if (answer.status === 403) throw new Lost("the server was started anew");
  if (!answer.ok) throw new Refused(answer.status, { error: reason(await answer.text()) });
  return createImageBitmap(await answer.blob());
}

function reason(text) {
  try { return JSON.parse(text).error; } catch { return text; }
}

// Draw a picture in place of the one before.
export function place(element, bitmap, words) {
  let canvas = element.querySelector("canvas");
  if (!canvas) {
    canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    element.replaceChildren(canvas);
  }
  canvas.setAttribute("aria-label", words);
  if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
}
