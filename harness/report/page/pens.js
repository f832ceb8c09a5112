// A canvas to draw on, and the page's colours for it.

export function canvasPen(sheet, width, height) {
  const scale = window.devicePixelRatio || 1;
  sheet.width = Math.round(width * scale);
  sheet.height = Math.round(height * scale);
  sheet.style.height = `${height}px`;
  const context = sheet.getContext("2d");
  context.scale(scale, scale);
  return {
    rect(x, y, w, h, colour, alpha = 1) {
      context.globalAlpha = alpha;
      context.fillStyle = colour;
      context.fillRect(x, y, w, h);
      context.globalAlpha = 1;
    },
    frame(x, y, w, h, colour, thick) {
      context.strokeStyle = colour;
      context.lineWidth = thick;
      context.strokeRect(x, y, w, h);
    },
    text(x, y, words, colour, { align = "left", size = 12, weight = 400 } = {}) {
      context.fillStyle = colour;
      context.font = `${weight} ${size}px system-ui, sans-serif`;
      context.textAlign = align;
      context.fillText(words, x, y);
    },
    measure(words, size) {
      context.font = `400 ${size}px system-ui, sans-serif`;
      return context.measureText(words).width;
    },
  };
}

// The page's colours from its style sheet, for a light or a dark screen.
export function palette() {
  const style = getComputedStyle(document.documentElement);
  const found = new Map(); // asking for a style takes longer than drawing
  const of = (name) => {
    if (!found.has(name)) {
      const colour = style.getPropertyValue(`--${name}`).trim();
      if (!colour) throw new Error(`the style sheet has no colour "${name}"`); // a canvas would keep the colour before
      found.set(name, colour);
    }
    return found.get(name);
  };
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const shade = (colour) => (dark ? colour : darker(colour));
  return { of, shade };
}

// Colours of targets are those of the recordings, which are dark; on a light page they are darker.
function darker(colour) {
  const parts = colour.match(/\d+/g);
  return parts ? `rgb(${parts.map((each) => Math.round(0.74 * each)).join(" ")})` : colour;
}
