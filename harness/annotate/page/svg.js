// Elements of SVG.

const NS = "http://www.w3.org/2000/svg";

export const shape = (tag, attributes) => {
  const made = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
};
