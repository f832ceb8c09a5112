// Elements of HTML and SVG, formatted numbers, and texts for screen readers.

export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

export function drawn(tag, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

export function button(text, action, attributes = {}) {
  const made = element("button", { type: "button", ...attributes }, text);
  made.addEventListener("click", action);
  return made;
}

export function choice(label, options, chosen, changed) {
  const select = element("select", {}, ...options.map(([value, text]) => element("option", { value }, text)));
  select.value = chosen;
  select.addEventListener("change", () => changed(select.value));
  return element("label", { class: "choice" }, `${label} `, select);
}

// A part of a figure that is a link: by pointer, Enter and Space.
export function actionable(group, label, action) {
  group.setAttribute("role", "button");
  group.setAttribute("tabindex", "0");
  group.setAttribute("aria-label", label);
  group.append(drawn("title", {}, label));
  group.addEventListener("click", action);
  group.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    action();
  });
  return group;
}

/** A share in percent, rounded as in the tables: halves to the even digit. */
export const percent = (share, digits = 1) => (share === null || Number.isNaN(share) ? "–" : (100 * share).toLocaleString("en", {
  minimumFractionDigits: digits, maximumFractionDigits: digits, roundingMode: "halfEven" }));
export const words = (name) => name.replaceAll("_", " ");

const live = document.getElementById("said");
export function say(text) {
  live.textContent = text;
  live.classList.remove("seen");
}

// Say it to those who see, too: an action has no other effect on the page.
let fading = null;
export function tell(text) {
  say(text);
  live.classList.add("seen");
  clearTimeout(fading);
  fading = setTimeout(() => live.classList.remove("seen"), 8000);
}

// Say on the page that it is drawn, once it is: figures draw when their width is known, which a first frame tells them.
export function sayDrawn() {
  requestAnimationFrame(() => requestAnimationFrame(() => { document.documentElement.dataset.ready = "yes"; }));
}
