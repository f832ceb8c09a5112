// The strip of frames: one row a subject, the run's suggestions below, a cursor, and ranges by dragging.

import { pieces } from "./tracks.js";

const DRAG_PX = 5;

function piece(each, total, look) {
  const box = document.createElement("i");
  box.className = `piece ${look(each.target)}`;
  if (each.suggested) box.classList.add("suggested");
  if (each.unseen) box.classList.add("unseen");
  box.style.left = `${100 * each.first / total}%`;
  box.style.width = `${100 * (each.last - each.first + 1) / total}%`;
  box.textContent = `${each.suggested ? "? " : ""}${each.target}${each.unseen ? " …" : ""}${each.note ? " ✎" : ""}`;
  box.title = [each.target, each.suggested && "a suggestion", each.unseen && "not seen yet", each.note]
    .filter(Boolean).join(", ");
  return box;
}

export class Strip {
  // look: name -> class; select(first, last): a range was dragged; seek(position, subject): a place was clicked.
  constructor(root, { total, look, select, seek }) {
    Object.assign(this, { root, total, look, select, seek });
    this.cursor = document.createElement("b");
    this.range = document.createElement("u");
    this.overlay = document.createElement("div");
    this.overlay.className = "over";
    this.overlay.append(this.range, this.cursor);
    this.point(0);
    this.mark(null);
    root.addEventListener("pointerdown", (event) => this.press(event));
  }

  draw({ subjects, subject, tracks, seen, suggestions }) {
    this.root.replaceChildren(...subjects.map((name) => {
      const row = this.row(name, name === subject ? "row current" : "row");
      row.lastChild.append(...pieces(tracks[name], seen[name])
        .filter((each) => each.target !== null).map((each) => piece(each, this.total, this.look)));
      return row;
    }));
    if (suggestions) this.root.append(this.suggested(suggestions));
    this.root.append(this.overlay);
  }

  row(name, className) {
    const row = document.createElement("div");
    row.className = className;
    row.dataset.subject = name;
    row.append(Object.assign(document.createElement("span"), { textContent: name }), document.createElement("div"));
    return row;
  }

  suggested(suggestions) {
    const row = this.row("", "row run");
    row.firstChild.textContent = "run";
    let open = null;
    suggestions.forEach((each, position) => {
      if (each && open && open.target === each[0]) open.last = position;
      else {
        if (open) row.lastChild.append(piece(open, this.total, this.look));
        open = each && { first: position, last: position, target: each[0] };
      }
    });
    if (open) row.lastChild.append(piece(open, this.total, this.look));
    return row;
  }

  point(position) {
    this.position = position;
    this.cursor.style.left = `${100 * (position + .5) / this.total}%`;
  }

  mark(selection) {
    this.selection = selection;
    this.range.hidden = !selection;
    if (!selection) return;
    this.range.style.left = `${100 * selection[0] / this.total}%`;
    this.range.style.width = `${100 * (selection[1] - selection[0] + 1) / this.total}%`;
  }

  positionAt(clientX) {
    const box = this.overlay.getBoundingClientRect();
    const share = (clientX - box.left) / box.width;
    return Math.min(Math.max(Math.floor(share * this.total), 0), this.total - 1);
  }

  press(event) {
    if (event.button) return;
    const start = this.positionAt(event.clientX);
    const row = event.target.closest("[data-subject]");
    let dragged = false;
    const move = (moved) => {
      dragged ||= Math.abs(moved.clientX - event.clientX) >= DRAG_PX;
      const end = this.positionAt(moved.clientX);
      if (dragged) this.mark([Math.min(start, end), Math.max(start, end)]);
    };
    const up = () => {
      removeEventListener("pointermove", move);
      if (dragged) this.select(this.selection); else this.seek(start, row && row.dataset.subject);
    };
    addEventListener("pointermove", move);
    addEventListener("pointerup", up, { once: true });
    event.preventDefault();
  }
}
