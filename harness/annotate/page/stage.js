// The left image with outlines, and the other views beside it.

import { get } from "./api.js";
import { Kept, loadPicture, place } from "./pictures.js";
import { shape } from "./svg.js";
import { View } from "./view.js";

const PICTURES = 16; // decoded ones are large
const SCENES = 200;
const LEAST_LETTERS = 14; // of a name on the picture, however small the object; the button below has all of it
const LETTER = .6; // width over height
const NARROW_PX = 500; // a picture of at most this width has smaller names

export class Stage {
  // name(object): its name and style; choose(object, point, at): it was clicked in the frame at this position; changed():
  // another part is shown.
  constructor({ name, choose, changed }) {
    Object.assign(this, { name, choose });
    this.pictures = new Kept(loadPicture, PICTURES, (bitmap) => bitmap.close());
    this.scenes = new Kept((at) => get(`/api/scene/${at}`), SCENES);
    this.picture = document.getElementById("picture");
    this.overlay = document.getElementById("overlay");
    this.extra = document.getElementById("extra");
    this.head = document.getElementById("head");
    this.view = new View(document.getElementById("stage"), changed);
    this.scene = null;
    this.drawn = [];
    this.beside = null;
    this.zoomed = false;
  }

  load(at) {
    return Promise.all([this.pictures.get(`/picture/left/${at}${this.view.query}`), this.scenes.get(at)]);
  }

  // One frame after the other: a browser has few connections, and a change must not wait behind pictures.
  async ahead(at, count, total) {
    this.from = at;
    for (let next = at + 1; next <= at + count && next < total && this.from === at; next += 1) {
      try { await this.load(next); } catch { return; }
    }
  }

  // Stop loading in advance.
  stay() { this.from = null; }

  show(bitmap, scene, at, subject) {
    place(this.picture, bitmap, "left view");
    const [width, height] = this.view.size = scene.size_px;
    this.view.element.style.setProperty("--aspect", width / height);
    const [u0, v0, u1, v1] = this.bounds = this.view.region || [0, 0, ...scene.size_px];
    this.overlay.setAttribute("viewBox", `${u0} ${v0} ${u1 - u0} ${v1 - v0}`);
    this.showBeside(at, subject, scene); // first, since it narrows the picture
    this.widthPx = this.view.element.clientWidth;
    this.unit = (u1 - u0) / this.widthPx; // pixels of the image per pixel of the screen
    Object.assign(this, { scene, at });
  }

  // Draw outlines and names of the frame that is shown, unless they are drawn already.
  draw(subject, names) {
    const { scene } = this;
    this.letter = (this.widthPx > NARROW_PX ? 17 : 12) * this.unit; // its height in pixels of the image
    const now = [scene, subject, names, this.letter, String(this.bounds)];
    if (!scene || now.every((each, place) => each === this.drawn[place])) return;
    this.drawn = now;
    this.overlay.style.setProperty("--letter", `${this.letter}px`);
    this.taken = [];
    const objects = scene.objects.map((each) => this.object(each, each.name === subject));
    const box = scene.heads_px[subject];
    if (box) {
      const [u0, v0, u1, v1] = box;
      objects.push(shape("rect", { x: u0, y: v0, width: u1 - u0, height: v1 - v0, class: "head" }));
    }
    this.overlay.replaceChildren(...objects);
  }

  object(each, isSubject) {
    const { text, className } = this.name(each);
    const group = shape("g", { class: `object ${isSubject ? "subject" : className}`, "data-name": each.name });
    const path = each.outline.map((points) => `M${points.map((point) => point.join(",")).join("L")}Z`).join("");
    group.append(shape("path", { d: path, class: "halo" }), shape("path", { d: path }));
    if (this.isInside(each.box_px)) group.append(this.label(isSubject ? each.name : text, each.box_px, isSubject));
    if (!isSubject) this.view.choosable(group, (event) => {
      const [point, at] = [this.pointOf(event), this.at];
      return () => this.choose(each, point, at);
    });
    return group;
  }

  isInside([u0, v0, u1, v1]) {
    const [left, top, right, bottom] = this.bounds;
    return u1 > left && u0 < right && v1 > top && v0 < bottom;
  }

  // Place a name within the picture and apart from the names already placed, shortened to the available space.
  label(words, [u0, v0, u1, v1], isHigh) {
    const most = Math.max(LEAST_LETTERS, Math.floor((u1 - u0) / this.letter / LETTER));
    const text = words.length > most ? `${words.slice(0, most - 1).trimEnd()}…` : words;
    const half = text.length * this.letter * LETTER / 2;
    const [left, top, right, bottom] = this.bounds;
    const x = Math.max(Math.min((u0 + u1) / 2, right - half), left + half);
    let y = isHigh ? v0 + .8 * this.letter : (Math.max(v0, top) + Math.min(v1, bottom)) / 2;
    const hides = (other) => Math.abs(other.x - x) < other.half + half && Math.abs(other.y - y) < this.letter;
    const step = (y < (top + bottom) / 2 ? 1.1 : -1.1) * this.letter;
    for (let tries = 0; tries < 2 && this.taken.some(hides); tries += 1) y += step;
    this.taken.push({ x, y, half });
    return Object.assign(shape("text", { x, y }), { textContent: text });
  }

  // Convert a place on the screen to pixels of the whole image.
  pointOf(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.overlay.getScreenCTM().inverse());
    return [Math.round(at.x * 10) / 10, Math.round(at.y * 10) / 10];
  }

  async showBeside(at, subject, scene) {
    this.extra.hidden = !this.beside;
    this.head.hidden = !this.zoomed;
    this.wanted = at;
    if (this.beside) await this.place(this.extra, `/picture/${this.beside}/${at}?width=640`, at, this.beside);
    if (!this.zoomed) return;
    if (scene.heads_px[subject]) {
      await this.place(this.head, `/picture/head/${at}?subject=${encodeURIComponent(subject)}`, at, "head");
    } else this.head.replaceChildren("no head found here");
  }

  async place(element, path, at, view) {
    try {
      const bitmap = await this.pictures.get(path);
      if (this.wanted === at) place(element, bitmap, view);
    } catch (error) { element.replaceChildren(error.message); }
  }
}
