// The part of the image that is shown, and the size to request: the wheel zooms, dragging moves. Also, what is pressed.

const FARTHEST = 16;
const STEP_PX = 160; // widths are rounded up to this, so that a resize asks for few new pictures
const DRAG_PX = 5;

export class View {
  // changed(): another part is shown; the element contains the picture.
  constructor(element, changed) {
    Object.assign(this, { element, changed, scale: 1, middle: [.5, .5], size: null, chosen: null });
    element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    element.addEventListener("pointerdown", (event) => this.press(event));
  }

  // [u0, v0, u1, v1] in pixels of the whole image; null: all of it.
  get region() {
    if (this.scale === 1 || !this.size) return null;
    const [[low, high], [top, bottom]] = this.size.map((length, axis) => {
      const half = length / 2 / this.scale;
      const middle = Math.min(Math.max(this.middle[axis] * length, half), length - half);
      return [Math.round(middle - half), Math.round(middle + half)];
    });
    return [low, top, high, bottom];
  }

  // The request to the server: as many pixels as the screen shows.
  get query() {
    const { region, size } = this;
    const [width, height] = region ? [region[2] - region[0], region[3] - region[1]] : size || [];
    const room = Math.min(this.element.clientWidth, width ? .62 * innerHeight * width / height : Infinity);
    const wanted = Math.max(Math.ceil(room * devicePixelRatio / STEP_PX), 2) * STEP_PX;
    const parts = [(!width || wanted < width) && `width=${wanted}`, region && `region=${region.join(",")}`].filter(Boolean);
    return parts.length ? `?${parts.join("&")}` : "";
  }

  // Zoom by a factor around a place of the element (0 to 1 in each direction).
  zoom(by, [across, down] = [.5, .5]) {
    const before = this.scale;
    this.scale = Math.min(Math.max(before * by, 1), FARTHEST);
    if (this.scale === before) return;
    const gain = 1 / before - 1 / this.scale;
    this.move((across - .5) * gain, (down - .5) * gain);
  }

  // Shares of the whole image.
  move(right, down) {
    const half = .5 / this.scale;
    this.middle = this.middle.map((each, axis) => Math.min(Math.max(each + [right, down][axis], half), 1 - half));
    this.changed();
  }

  placeOf(event) {
    const box = this.element.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  wheel(event) {
    if (this.scale === 1 && event.deltaY > 0) return; // the page scrolls
    event.preventDefault();
    this.zoom(event.deltaY < 0 ? 1.25 : .8, this.placeOf(event));
  }

  // Let a press on an element choose it: what pressed(event) returns is called when the pointer goes up, unless it has
  // dragged the image. A click is not enough: an element that is drawn anew in between, as while the clip plays, has none.
  choosable(element, pressed) {
    element.addEventListener("pointerdown", (event) => { this.chosen = pressed(event); });
  }

  press(event) {
    const { chosen } = this;
    this.chosen = null;
    if (event.button || event.defaultPrevented) return;
    let from = this.placeOf(event);
    let dragged = false;
    const move = (moved) => {
      dragged ||= this.scale !== 1 && Math.hypot(moved.clientX - event.clientX, moved.clientY - event.clientY) >= DRAG_PX;
      if (!dragged) return;
      const to = this.placeOf(moved);
      this.move((from[0] - to[0]) / this.scale, (from[1] - to[1]) / this.scale);
      from = to;
    };
    const end = ({ type }) => {
      removeEventListener("pointermove", move);
      removeEventListener("pointerup", end);
      removeEventListener("pointercancel", end);
      if (chosen && !dragged && type === "pointerup") chosen();
    };
    addEventListener("pointermove", move);
    addEventListener("pointerup", end);
    addEventListener("pointercancel", end);
  }
}
