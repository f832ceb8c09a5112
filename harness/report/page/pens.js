// One way to draw, on a canvas or as the text of an SVG.

export function canvasPen(sheet, width, height) {
  const scale = window.devicePixelRatio || 1;
  sheet.width = Math.round(width * scale);
  sheet.height = Math.round(height * scale);
  sheet.style.height = `${height}px`;
  const context = sheet.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return {
    rect(x, y, w, h, colour, alpha = 1) {
      context.globalAlpha = alpha;
      context.fillStyle = colour;
      context.fillRect(x, y, w, h);
      context.globalAlpha = 1;
    },
    frame(x, y, w, h, colour, thick = 1) {
      context.strokeStyle = colour;
      context.lineWidth = thick;
      context.setLineDash([]);
      context.strokeRect(x, y, w, h);
    },
    line(points, colour, thick = 1, dash = "") {
      context.strokeStyle = colour;
      context.lineWidth = thick;
      context.setLineDash(dash ? dash.split(" ").map(Number) : []);
      context.beginPath();
      points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.stroke();
    },
    text(x, y, words, colour, { align = "left", size = 12, weight = 400 } = {}) {
      context.fillStyle = colour;
      context.font = `${weight} ${size}px system-ui, sans-serif`;
      context.textAlign = align;
      context.fillText(words, x, y);
    },
    image(picture, x, y, w, h) {
      context.drawImage(picture, x, y, w, h);
    },
    measure: (words, size = 12) => {
      context.font = `400 ${size}px system-ui, sans-serif`;
      return context.measureText(words).width;
    },
    clipped(x, y, w, h, draw) {
      context.save();
      context.beginPath();
      context.rect(x, y, w, h);
      context.clip();
      draw();
      context.restore();
    },
  };
}

const escaped = (words) => String(words).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll('"', "&quot;");
const short = (value) => Math.round(100 * value) / 100;

export function svgPen(width, height, ground) {
  const parts = [`<rect width="${width}" height="${height}" fill="${ground}"/>`];
  let clips = 0;
  return {
    rect: (x, y, w, h, colour, alpha = 1) =>
      parts.push(`<rect x="${short(x)}" y="${short(y)}" width="${short(w)}" height="${short(h)}" fill="${colour}"${alpha < 1 ? ` opacity="${alpha}"` : ""}/>`),
    frame: (x, y, w, h, colour, thick = 1) =>
      parts.push(`<rect x="${short(x)}" y="${short(y)}" width="${short(w)}" height="${short(h)}" fill="none" stroke="${colour}" stroke-width="${thick}"/>`),
    line: (points, colour, thick = 1, dash = "") =>
      parts.push(`<polyline points="${points.map(([x, y]) => `${short(x)},${short(y)}`).join(" ")}" fill="none" stroke="${colour}" stroke-width="${thick}"${dash ? ` stroke-dasharray="${dash}"` : ""}/>`),
    text: (x, y, words, colour, { align = "left", size = 12, weight = 400 } = {}) =>
      parts.push(`<text x="${short(x)}" y="${short(y)}" fill="${colour}" font-family="system-ui, sans-serif" font-size="${size}" font-weight="${weight}" text-anchor="${{ left: "start", center: "middle", right: "end" }[align]}">${escaped(words)}</text>`),
    image: (picture, x, y, w, h) => parts.push(`<image href="${picture.src}" x="${short(x)}" y="${short(y)}" width="${short(w)}" height="${short(h)}"/>`),
    measure: (words, size = 12) => 0.56 * size * words.length,
    clipped(x, y, w, h, draw) {
      clips += 1;
      parts.push(`<clipPath id="c${clips}"><rect x="${x}" y="${y}" width="${w}" height="${h}"/></clipPath><g clip-path="url(#c${clips})">`);
      draw();
      parts.push("</g>");
    },
    done: () => `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}">${parts.join("")}</svg>`,
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
  const shade = (colour) => {
    if (!found.has(colour)) found.set(colour, dark ? colour : darker(colour));
    return found.get(colour);
  };
  return { of, shade };
}

// Colours of targets are those of the recordings, which are dark; on a light page they are darker.
function darker(colour) {
  const parts = colour.match(/\d+/g);
  return parts ? `rgb(${parts.map((each) => Math.round(0.74 * each)).join(" ")})` : colour;
}
