// The plan of a clip without images: a grid in metres and where heads and eyes point, below the outlines.

import { shape } from "./svg.js";

const STEPS = [1, 2, 5];
const FEWEST = 4; // lines each way

export class Plan {
  // The element in which pictures are shown otherwise.
  constructor(element) {
    this.svg = shape("svg", { role: "img", "aria-label": "plan, seen from above", id: "plan" });
    this.element = element;
  }

  // bounds: [u0, v0, u1, v1] of what is shown; letter: the height of text in its pixels.
  draw({ plan, size_px: size }, [u0, v0, u1, v1], subject, letter) {
    if (!this.svg.isConnected) {
      this.element.replaceChildren(this.svg);
      this.element.parentElement.classList.add("plan");
    }
    this.svg.setAttribute("viewBox", `${u0} ${v0} ${u1 - u0} ${v1 - v0}`);
    this.svg.style.aspectRatio = `${size[0]} / ${size[1]}`;
    this.svg.style.setProperty("--letter", `${letter}px`);
    this.svg.replaceChildren(...this.grid(plan, [u0, v0, u1, v1], letter), ...plan.rays.map((ray) => this.ray(ray, subject, letter)));
  }

  // Lines at round metres: x to the right, z away from the camera; the origin is marked.
  grid({ px_per_m: scale, origin_px: [originU, originV] }, [u0, v0, u1, v1], letter) {
    const step = roundStep(Math.min(u1 - u0, v1 - v0) / scale / FEWEST);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const found = [];
    for (let k = Math.ceil((u0 - originU) / scale / step); originU + k * step * scale <= u1; k += 1) {
      const u = originU + k * step * scale;
      found.push(shape("line", { x1: u, x2: u, y1: v0, y2: v1 }), note(`${(k * step).toFixed(digits)} m`, u + .3 * letter, v1 - .4 * letter));
    }
    for (let k = Math.ceil((originV - v1) / scale / step); originV - k * step * scale >= v0 + 2 * letter; k += 1) {
      const v = originV - k * step * scale;
      found.push(shape("line", { x1: u0, x2: u1, y1: v, y2: v }));
      if (v < v1 - 2 * letter) found.push(note(`${(k * step).toFixed(digits)} m`, u0 + .3 * letter, v - .3 * letter));
    }
    found.push(note("seen from above; solid: the head, dashed: the eyes", u0 + .3 * letter, v0 + 1.1 * letter));
    found.push(shape("path", { class: "origin", d: `M${originU - letter / 2} ${originV}h${letter}M${originU} ${originV - letter / 2}v${letter}` }));
    return found;
  }

  // An arrow from the eyes; its length is that of the direction seen from above.
  ray({ name, cue, from_px: [u0, v0], to_px: [u1, v1] }, subject, letter) {
    const length = Math.hypot(u1 - u0, v1 - v0);
    const group = shape("g", { class: `ray by-${cue} ${name === subject ? "chosen" : ""}`, "data-name": name, "data-cue": cue });
    group.append(shape("line", { x1: u0, y1: v0, x2: u1, y2: v1 }));
    if (length > 0) {
      const [along, across] = [(u1 - u0) / length, (v1 - v0) / length].map((each) => each * .6 * letter);
      const side = (turn) => `${u1 - along - turn * across / 2} ${v1 - across + turn * along / 2}`;
      group.append(shape("path", { d: `M${u1} ${v1}L${side(1)}L${side(-1)}Z` }));
    }
    return group;
  }
}

function note(text, x, y) { return Object.assign(shape("text", { x, y }), { textContent: text }); }

// The largest of 1, 2, 5 times a power of ten that is at most this.
function roundStep(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return power * STEPS.findLast((each) => each * power <= most * (1 + 1e-9));
}
