// Tables and figures to the clipboard; where that is refused, as a file.

import { element, tell } from "./dom.js";

const CELL = /[",\r\n]/;
export const csvText = (rows) =>
  rows.map((row) => row.map((cell) => (CELL.test(cell) ? `"${String(cell).replaceAll('"', '""')}"` : cell)).join(",")).join("\n") + "\n";

export const copyCsv = (rows) => copied(new Blob([csvText(rows)], { type: "text/plain" }), "csv");
export const copySvg = (svg) => svg ? copied(new Blob([svgText(svg)], { type: "text/plain" }), "svg") : tell("Nothing is drawn here yet.");
export const copyPng = async (svg) => {
  if (!svg) return tell("Nothing is drawn here yet.");
  try {
    return await copied(await png(svgText(svg), svg.width.baseVal.value, svg.height.baseVal.value), "png");
  } catch (error) {
    return tell(`This figure could not be turned into a PNG (${error.message}); copy it as SVG instead.`);
  }
};

async function copied(blob, kind) {
  try {
    await navigator.clipboard.write([new ClipboardItem({ [blob.type]: blob })]);
    tell(`Copied as ${kind.toUpperCase()}.`);
  } catch {
    const address = URL.createObjectURL(blob);
    element("a", { href: address, download: `figure.${kind}` }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
    tell(`The clipboard is closed to this page: saved as figure.${kind}.`);
  }
}

const KEPT = ["fill", "stroke", "stroke-width", "stroke-dasharray", "opacity", "font-family", "font-size", "font-weight", "text-anchor"];

// A drawing that looks the same outside the page: it contains its styles and the page's background.
export function svgText(svg) {
  const copy = svg.cloneNode(true);
  const places = [svg, ...svg.querySelectorAll("*")];
  [copy, ...copy.querySelectorAll("*")].forEach((each, i) => {
    const style = getComputedStyle(places[i]);
    for (const name of KEPT) each.setAttribute(name, style.getPropertyValue(name));
    for (const name of ["class", "tabindex", "role", "style"]) each.removeAttribute(name);
  });
  const ground = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  ground.setAttribute("width", "100%");
  ground.setAttribute("height", "100%");
  ground.setAttribute("fill", getComputedStyle(document.body).backgroundColor);
  copy.prepend(ground);
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  return new XMLSerializer().serializeToString(copy);
}

async function png(text, width, height) {
  const image = new Image();
  await new Promise((resolve, reject) => {
    image.addEventListener("load", resolve);
    image.addEventListener("error", () => reject(new Error("the browser cannot read the drawing")));
    image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
  });
  const sheet = element("canvas", { width: 2 * width, height: 2 * height });
  sheet.getContext("2d").drawImage(image, 0, 0, 2 * width, 2 * height);
  return new Promise((resolve) => sheet.toBlob(resolve, "image/png"));
}
