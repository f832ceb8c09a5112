// One undo for labels and drawing: in the order in which they were changed, whichever was changed.

import * as panel from "./panel.js";

export class Undo {
  constructor(page) { this.page = page; }

  // Which of the two is undone or redone next; undefined: neither. What was undone before something new was made is gone.
  next(kind) {
    const { state, drawing } = this.page;
    const both = [{ name: "label", state }, { name: "drawing", state: drawing.state }];
    const newest = (time, found) => found.toSorted((one, other) => time(one) - time(other)).at(-1);
    if (kind === "undo") return newest((each) => each.state.made_s, both.filter((each) => each.state.can_undo));
    const made = Math.max(...both.map((each) => each.state.made_s ?? 0));
    return newest((each) => each.state.undone_s, both.filter((each) => each.state.can_redo && each.state.undone_s >= made));
  }

  can(kind) { return this.next(kind) !== undefined; }

  press(kind) {
    const { page } = this;
    page.drawing.rest();
    page.seen.tell();
    const id = crypto.randomUUID(); // sent again after a loss, it is not done twice
    let ask;
    page.queue.add(() => {
      ask ??= this.choose(kind, id);
      return ask();
    });
  }

  choose(kind, id) {
    const { page } = this;
    const found = this.next(kind);
    if (!found) return () => {};
    const { revision } = found.state;
    const isElsewhere = (found.name === "drawing") !== page.drawing.on;
    return async () => {
      if (found.name === "drawing") await page.drawing.ask({ do: kind, id, revision });
      else await page.said.ask({ kind, id, revision });
      if (isElsewhere) panel.say(`${kind === "undo" ? "Undone" : "Done again"}: the last change of the ${found.name === "drawing" ? "drawing" : "labels"}.`);
    };
  }
}
