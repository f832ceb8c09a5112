// Boxes and points on the image, with handles for the pointer.

import { shape } from "./svg.js";

const HANDLE_PX = 26; // on the screen, however small the image is
const DRAG_PX = 4;
const LEAST_PX = 2; // of a box, in pixels of the image
const CORNERS = [[0, 1], [2, 1], [0, 3], [2, 3]]; // which numbers of a place each handle moves
const HALF = .5; // whole numbers are pixels' centres, and the picture begins half a pixel before the first

const sorted = ([a, b, c, d]) => [Math.min(a, c), Math.min(b, d), Math.max(a, c), Math.max(b, d)];

export class Shapes {
  // chosen(): the selected { name, kind }; choose(name, kind): another was clicked; live(place): it is being drawn;
  // done(place): it was drawn, null: cancelled; look(name, at): it was clicked with the drawing tool closed, in the frame
  // at this position.
  constructor(stage, handlers) {
    Object.assign(this, handlers, { stage });
    this.svg = shape("svg", { id: "drawn", "aria-hidden": "true" });
    document.getElementById("stage").append(this.svg);
    this.svg.addEventListener("pointerdown", (event) => this.press(event));
  }

  // Pixels of the image per pixel of the screen.
  get unit() {
    const matrix = this.svg.getScreenCTM();
    return matrix ? 1 / matrix.a : 1;
  }

  // Of the whole image.
  get size() { return this.stage.scene.size_px ?? [this.stage.width, this.stage.height]; }

  // found: { name, kind, place, state, text, className, isChosen } each; the chosen one has handles where it is drawn.
  draw(found, isOn) {
    const box = this.stage.overlay.getAttribute("viewBox");
    if (!box) return;
    this.svg.setAttribute("viewBox", box);
    this.svg.classList.toggle("on", isOn);
    this.svg.style.setProperty("--letter", `${this.stage.letter}px`);
    this.found = found;
    this.svg.replaceChildren(...found.map((each) => this.one(each, isOn)));
  }

  one(each, isOn) {
    const { unit } = this;
    const [u0, v0, u1 = u0, v1 = v0] = each.place.map((at) => at + HALF);
    const group = shape("g", {
      class: `drawn ${each.state} ${each.className} ${each.isChosen ? "chosen" : ""}`, "data-name": each.name, "data-kind": each.kind,
    });
    const outline = each.kind === "point"
      ? shape("circle", { cx: u0, cy: v0, r: HANDLE_PX / 2 * unit })
      : shape("rect", { x: u0, y: v0, width: u1 - u0, height: v1 - v0 });
    const halo = outline.cloneNode();
    halo.setAttribute("class", "halo");
    group.append(halo, outline);
    if (each.kind === "point") group.append(shape("circle", { cx: u0, cy: v0, r: 3 * unit, class: "dot" }));
    const text = shape("text", { x: u0, y: Math.max(v0 - .4 * this.stage.letter, this.stage.letter) });
    text.textContent = each.text;
    group.append(text);
    const { stage, look } = this;
    if (!isOn) stage.view.choosable(group, () => { const { at } = stage; return () => look(each.name, at); });
    if (isOn && each.isChosen && each.kind !== "point") group.append(...this.handles([u0, v0, u1, v1], unit));
    return group;
  }

  // Handles are outside the box, so that small boxes can be moved, but within the picture.
  handles(box, unit) {
    const size = HANDLE_PX * unit;
    const { x: left, y: top, width, height } = this.svg.viewBox.baseVal;
    const within = (at, low, length) => Math.min(Math.max(at, low), low + length - size);
    return CORNERS.map(([across, down], corner) => shape("rect", {
      x: within(box[across] - (across === 0 ? size : 0), left, width),
      y: within(box[down] - (down === 1 ? size : 0), top, height),
      width: size, height: size, class: "handle", "data-corner": corner,
    }));
  }

  pointOf(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    return [at.x - HALF, at.y - HALF];
  }

  inImage([u, v]) {
    const [width, height] = this.size;
    return [Math.min(Math.max(u, -HALF), width - HALF), Math.min(Math.max(v, -HALF), height - HALF)];
  }

  press(event) {
    if (event.button || !this.stage.scene || !this.svg.classList.contains("on")) return;
    const group = event.target.closest("g");
    event.preventDefault();
    event.stopPropagation();
    const { name, kind } = this.chosen();
    const own = this.found.find((each) => each.isChosen);
    const isOwn = group !== null && group.dataset.name === name && group.dataset.kind === kind;
    const from = this.pointOf(event);
    const change = this.changeOf({ kind, own, isOwn, corner: event.target.dataset.corner, from });
    let place = null;
    const move = (moved) => {
      if (place || Math.hypot(moved.clientX - event.clientX, moved.clientY - event.clientY) >= DRAG_PX) {
        place = change(this.pointOf(moved));
        this.live(place);
      }
    };
    const end = () => {
      removeEventListener("pointermove", move);
      removeEventListener("pointerup", up);
      removeEventListener("keydown", escape, true);
    };
    const up = () => {
      end();
      if (place && this.isLarge(place)) this.done(place);
      else if (!place && kind === "point" && !group) this.done(this.inImage(from));
      else if (!place && group && !isOwn) this.choose(group.dataset.name, group.dataset.kind);
      else this.done(null);
    };
    const escape = (pressed) => {
      if (pressed.key !== "Escape") return;
      pressed.stopImmediatePropagation();
      end();
      this.done(null);
    };
    addEventListener("pointermove", move);
    addEventListener("pointerup", up);
    addEventListener("keydown", escape, true);
  }

  // The pointer's position -> the place being drawn: a corner or the whole shape is moved, or a new one is made.
  changeOf({ kind, own, isOwn, corner, from }) {
    if (isOwn && corner !== undefined) {
      const [across, down] = CORNERS[corner];
      return (to) => {
        const place = [...own.place];
        [place[across], place[down]] = this.inImage(to);
        return sorted(place);
      };
    }
    if (isOwn) return ([u, v]) => own.place.map((at, axis) => at + [u - from[0], v - from[1]][axis % 2]);
    if (kind === "point") return (to) => this.inImage(to);
    return (to) => sorted([...this.inImage(from), ...this.inImage(to)]);
  }

  isLarge(place) {
    return place.length === 2 || (place[2] - place[0] >= LEAST_PX && place[3] - place[1] >= LEAST_PX);
  }
}
