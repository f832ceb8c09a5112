// The strip of frames: one row a subject, the run's suggestions below, a cursor, and ranges by dragging.

import { pieces } from "./tracks.js";

const DRAG_PX = 5;

function piece(each, total, look) {
  const box = document.createElement("i");
  box.className = `piece ${look(each.target)}`;
  if (each.suggested) box.classList.add("suggested");
  if (each.unseen) box.classList.add("unseen");
  if (each.undecided) box.classList.add("undecided");
  box.style.left = `${100 * each.first / total}%`;
  box.style.width = `${100 * (each.last - each.first + 1) / total}%`;
  const noted = `${each.target}${each.unseen ? " …" : ""}${each.note ? " ✎" : ""}`;
  box.textContent = `${each.suggested || each.undecided ? "? " : ""}${each.undecided || noted}`;
  box.title = [each.target, each.suggested && "a suggestion", each.unseen && "not seen yet", each.note]
    .filter(Boolean).join(", ");
  return box;
}

export class Strip {
  // look: name -> class; select(first, last): a range was dragged; seek(position, subject): a place was clicked.
  constructor(root, { frames, look, select, seek }) {
    Object.assign(this, { root, frames, total: frames.length, look, select, seek, rows: new Map() });
    this.cursor = document.createElement("b");
    this.range = document.createElement("u");
    this.overlay = document.createElement("div");
    this.overlay.className = "over";
    this.overlay.append(this.range, this.cursor);
    this.point(0);
    this.mark(null);
    root.addEventListener("pointerdown", (event) => this.press(event));
  }

  // A row is made anew only when what it shows has changed: a long clip has hundreds of pieces.
  draw({ subjects, subject, tracks, seen, revision, names, suggestions }) {
    const rows = subjects.map((name) => this.keep(name, [revision, names, seen[name]], () => this.labels(name, tracks[name], seen[name])));
    for (const row of rows) row.classList.toggle("current", row.dataset.subject === subject);
    if (suggestions) rows.push(this.keep("", [names, suggestions], () => this.suggested(suggestions)));
    rows.push(this.overlay);
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

  row(name, words, className) {
    const row = document.createElement("div");
    row.className = `row ${className}`;
    row.dataset.subject = name;
    row.append(Object.assign(document.createElement("span"), { textContent: words, title: words }), document.createElement("div"));
    return row;
  }

  labels(name, track, seen) {
    const row = this.row(name, name, "");
    const found = pieces(track, seen).filter((each) => each.target !== null);
    row.lastChild.append(...found.map((each) => piece(each, this.total, this.look)));
    const said = found.map((each) => `${each.target} ${this.frames[each.first]} to ${this.frames[each.last]}`);
    row.setAttribute("role", "img");
    row.setAttribute("aria-label", `${name}: ${said.join(", ") || "not labelled"}`);
    return row;
  }

  suggested(suggestions) {
    const row = this.row("", "run", "run");
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
