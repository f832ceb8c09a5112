// A timeline: an axis, one row per subject, the run's suggestions below, a cursor, and ranges by dragging. It shows
// the whole clip, or as many frames around the current one as fit.

import { Axis } from "./axis.js";
import { coarse, pieces, runs } from "./tracks.js";

const DRAG_PX = 5;
const EDGE_PX = 4; // on both sides of a change that is dragged
const FINEST = 600; // pieces a row: more are narrower than can be seen
const SPOKEN = 40; // pieces a row that a screen reader is told

function piece(each, look) {
  const box = document.createElement("i");
  box.className = `piece ${look(each.target)}`;
  if (each.suggested) box.classList.add("suggested");
  if (each.unseen) box.classList.add("unseen");
  box.textContent = `${each.suggested ? "? " : ""}${each.target}${each.unseen ? " …" : ""}${each.note || each.tags ? " ✎" : ""}`;
  box.title = [each.target, each.suggested && "a suggestion", each.unseen && "not seen yet", each.note, each.tags]
    .filter(Boolean).join(", ");
  return box;
}

export class Timeline {
  // look: name -> class; select(range, subject): a range was dragged, on this subject's row if any; seek(position,
  // subject): a place was clicked, or the axis was dragged; stretch(position, subject): a place was double-clicked;
  // move(change, to, subject): a change of target was dragged. advised: the frames to label first.
  constructor(root, { frames, times, advised, count, look, select, seek, stretch, move }) {
    Object.assign(this, { root, frames, times, advised, count, look, select, seek, stretch, move, rows: new Map(), first: 0 });
    this.axis = new Axis(frames, times);
    [this.cursor, this.range, this.looped, this.edge] = ["b", "u", "q", "em"].map((tag) => document.createElement(tag));
    this.edge.hidden = true;
    this.overlay = document.createElement("div");
    this.overlay.className = "over";
    this.overlay.append(this.looped, this.range, this.edge, this.cursor);
    this.mark(null);
    root.addEventListener("pointerdown", (event) => this.press(event));
    root.addEventListener("pointermove", (event) => root.classList.toggle("edge", this.changeAt(event) !== null));
    root.addEventListener("dblclick", (event) => {
      const row = event.target.closest("[data-subject]");
      if (row?.dataset.subject) this.stretch(this.positionAt(event.clientX), row.dataset.subject);
    });
  }

  // A row is rebuilt only when its content has changed: a long clip has hundreds of pieces.
  draw(position, { subjects, subject, tracks, seen, names, suggestions, loop, said }) {
    this.tracks = tracks;
    if (!this.isHeld) this.first = Math.max(Math.min(position - Math.floor(this.count / 2), this.frames.length - this.count), 0);
    const window = `${this.first} ${this.count}`;
    this.axis.draw(this.first, this.count, position, said);
    const rows = [this.axis.row, ...subjects.map((name) => this.keep(
      name, [window, names, tracks[name], seen[name]], () => this.labels(name, tracks[name], seen[name]),
    ))];
    for (const row of rows) row.classList.toggle("current", row.dataset.subject === subject);
    if (suggestions) rows.push(this.keep("", [window, names, suggestions], () => this.suggested(suggestions)));
    rows.push(this.overlay);
    this.cursor.style.left = `${100 * (position + .5 - this.first) / this.count}%`;
    this.mark(this.selection);
    this.put(this.looped, loop);
    if (rows.length !== this.root.children.length || rows.some((row, place) => row !== this.root.children[place])) {
      this.root.replaceChildren(...rows);
    }
  }

  keep(name, shows, make) {
    const kept = this.rows.get(name);
    if (kept && shows.every((each, place) => each === kept.shows[place])) return kept.row;
    const row = make();
    this.rows.set(name, { shows, row });
    return row;
  }

  shows(first, last) { return first < this.first + this.count && last >= this.first; }

  // Place an element at a range of frames.
  place(element, first, last) {
    const [start, end] = [Math.max(first - this.first, 0), Math.min(last + 1 - this.first, this.count)];
    element.style.left = `${100 * start / this.count}%`;
    element.style.width = `${100 * (end - start) / this.count}%`;
    return element;
  }

  fill(row, found) {
    const shown = coarse(found.filter((each) => this.shows(each.first, each.last)), this.first, this.count, FINEST);
    row.lastChild.append(...shown.map((each) => this.place(piece(each, this.look), each.first, each.last)));
    return row;
  }

  row(name, words, className) {
    const row = document.createElement("div");
    row.className = `row ${className}`;
    row.dataset.subject = name;
    row.append(Object.assign(document.createElement("span"), { textContent: words, title: words }), document.createElement("div"));
    return row;
  }

  labels(name, track, seen) {
    const found = pieces(track, seen).filter((each) => each.target !== null);
    const row = this.fill(this.row(name, name, ""), found);
    const said = found.slice(0, SPOKEN).map((each) => `${each.target} ${this.frames[each.first]} to ${this.frames[each.last]}`);
    if (found.length > SPOKEN) said.push(`and ${found.length - SPOKEN} more`);
    const advised = this.advised.filter((each) => each.subject === name && this.shows(each.first, each.last));
    row.lastChild.append(...advised.map(({ first, last }) => this.place(Object.assign(document.createElement("em"), { title: "to label first" }), first, last)));
    row.setAttribute("role", "img");
    row.setAttribute("aria-label", `${name}: ${said.join(", ") || "not labelled"}`);
    return row;
  }

  suggested(suggestions) {
    const found = [];
    suggestions.forEach((each, position) => {
      const before = found[found.length - 1];
      if (each && before && before.target === each[0] && before.last === position - 1) before.last = position;
      else if (each) found.push({ first: position, last: position, target: each[0] });
    });
    return this.fill(this.row("", "run", "run"), found);
  }

  mark(selection) {
    this.selection = selection;
    this.put(this.range, selection);
  }

  put(element, range) {
    element.hidden = !range || !this.shows(...range);
    if (!element.hidden) this.place(element, ...range);
  }

  positionAt(clientX) {
    const box = this.overlay.getBoundingClientRect();
    const share = (clientX - box.left) / box.width;
    return this.first + Math.min(Math.max(Math.floor(share * this.count), 0), this.count - 1);
  }

  // The change of target under the pointer, as { subject, at }; null if there is none. Suggestions do not move.
  changeAt(event) {
    const subject = event.target.closest("[data-subject]")?.dataset.subject;
    if (!subject || event.target.closest("span")) return null;
    const box = this.overlay.getBoundingClientRect();
    const all = runs(this.tracks[subject]);
    const isNear = (at) => Math.abs(box.left + (at - this.first) / this.count * box.width - event.clientX) <= EDGE_PX;
    const place = all.findIndex((each, number) => number && isNear(each.first) && !each.suggested && !all[number - 1].suggested);
    return place < 0 ? null : { subject, at: all[place].first };
  }

  // The frame's edge nearest to the pointer.
  edgeAt(clientX) {
    const box = this.overlay.getBoundingClientRect();
    return this.first + Math.min(Math.max(Math.round((clientX - box.left) / box.width * this.count), 0), this.count);
  }

  // Dragging on the axis moves through the clip; dragging a change of target moves it; dragging on the rows elsewhere
  // selects a range.
  press(event) {
    if (event.button) return;
    const isScrub = Boolean(event.target.closest(".axis"));
    const start = this.positionAt(event.clientX);
    const row = event.target.closest("[data-subject]");
    const change = this.changeAt(event);
    let dragged = false;
    let range = null;
    this.isHeld = true; // the timeline stands still while it is dragged
    const move = (moved) => {
      dragged ||= Math.abs(moved.clientX - event.clientX) >= DRAG_PX;
      const end = this.positionAt(moved.clientX);
      if (isScrub) this.seek(end, null);
      else if (dragged && change) {
        this.edge.hidden = false;
        this.edge.style.left = `${100 * (this.edgeAt(moved.clientX) - this.first) / this.count}%`;
      } else if (dragged) this.mark(range = [Math.min(start, end), Math.max(start, end)]);
    };
    const up = (released) => {
      removeEventListener("pointermove", move);
      this.isHeld = false;
      this.edge.hidden = true;
      if (isScrub && dragged) return;
      if (dragged && change) this.move(change.at, this.edgeAt(released.clientX), change.subject);
      else if (dragged) this.select(range, row?.dataset.subject);
      else this.seek(start, row && row.dataset.subject);
    };
    addEventListener("pointermove", move);
    addEventListener("pointerup", up, { once: true });
    event.preventDefault();
  }
}
