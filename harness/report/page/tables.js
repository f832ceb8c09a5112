// The tables: built when their section is opened, sorted by a click on a column, filtered by words, page by page.

import { copyCsv } from "./copying.js";
import { button, element } from "./dom.js";
import { packedJson } from "./packs.js";

const PAGE = 50;
const amount = (cell) => Number.parseFloat(cell.replace("<", "").replace("−", "-"));

const isUnknown = (cell) => ["–", ""].includes(cell);

// What is unknown is last in both orders.
function compared(a, b, words, falls) {
  if (isUnknown(a) || isUnknown(b)) return isUnknown(a) - isUnknown(b);
  const [first, second] = [amount(a), amount(b)];
  const areWords = words || Number.isNaN(first) || Number.isNaN(second);
  return (falls ? -1 : 1) * (areWords ? a.localeCompare(b, undefined, { numeric: true }) : first - second);
}

/** A table. `links` are functions by column, from the number of a row to the address that its cell leads to, or none. */
export function tableOf({ title, columns, words, rows, notes = [], links = {} }) {
  let [order, falls, filter, at] = [null, false, "", 0];
  const body = element("tbody");
  const heads = columns.map((name, i) => {
    const head = element("th", { scope: "col", ...(i >= words ? { class: "n" } : {}) });
    head.append(button(name, () => {
      falls = order === i ? !falls : i >= words;
      order = i;
      heads.forEach((each) => each.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", falls ? "descending" : "ascending");
      show(-at);
    }, { class: "head" }));
    return head;
  });
  const chosen = () => {
    const found = rows.map((row, i) => [row, i]).filter(([row]) => !filter || row.slice(0, words).some((cell) => cell.toLowerCase().includes(filter)));
    if (order !== null) found.sort(([a], [b]) => compared(a[order], b[order], order < words, falls));
    return found;
  };
  const where = element("span", { class: "small", role: "status" });
  const show = (by) => {
    const found = chosen();
    at = Math.min(Math.max(at + by, 0), Math.max(Math.ceil(found.length / PAGE) - 1, 0));
    body.replaceChildren(...found.slice(at * PAGE, (at + 1) * PAGE).map(([row, place]) =>
      element("tr", {}, ...row.map((cell, i) => {
        const href = links[i]?.(place);
        const shown = href ? element("a", { href }, cell) : cell;
        return i === 0 ? element("th", { scope: "row" }, shown) : element("td", i >= words ? { class: "n" } : {}, shown);
      }))));
    where.textContent = found.length > PAGE ? `${at * PAGE + 1} to ${Math.min((at + 1) * PAGE, found.length)} of ${found.length}` : "";
  };
  const search = element("input", { type: "search", placeholder: "filter", "aria-label": `Filter the rows of ${title}` });
  search.addEventListener("input", () => { filter = search.value.toLowerCase(); show(-at); });
  const turns = rows.length > PAGE ? [button("‹", () => show(-1), { "aria-label": "Rows before" }), where, button("›", () => show(1), { "aria-label": "Next rows" })] : [];
  show(0);
  return element("div", {},
    element("div", { class: "controls" }, ...(rows.length > 8 ? [search] : []), ...turns,
      button("Copy as CSV", () => copyCsv([columns, ...chosen().map(([row]) => row)]), { "aria-label": `Copy ${title} as CSV` })),
    element("div", { class: "wide", tabindex: "0", role: "region", "aria-label": title },
      element("table", {}, element("caption", {}, title), element("thead", {}, element("tr", {}, ...heads)), body)),
    ...(notes.length ? [element("ul", { class: "small" }, ...notes.map((note) => element("li", {}, note)))] : []));
}

/** Fill the tables as their sections are opened; `said` changes the words of their notes. */
export function fillTables(said = (note) => note) {
  for (const fold of document.querySelectorAll("details[data-table]")) {
    const fill = async () => {
      if (!fold.open || fold.dataset.filled) return;
      fold.dataset.filled = "yes";
      const tables = await packedJson("tables");
      const { links = {}, notes = [], ...table } = tables[Number(fold.dataset.table)];
      const leadTo = Object.entries(links).map(([column, addresses]) => [column, (place) => addresses[place]]);
      fold.append(tableOf({ ...table, notes: notes.map(said), links: Object.fromEntries(leadTo) }));
    };
    fold.addEventListener("toggle", fill);
    fill();
  }
  const manifest = document.querySelector("details[data-manifest]");
  manifest?.addEventListener("toggle", async () => {
    if (manifest.childElementCount < 2) manifest.append(element("pre", { tabindex: "0" }, await packedJson("manifest")));
  });
}
