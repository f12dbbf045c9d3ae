// Colour scales as 256 entries of 32-bit RGBA (little-endian), and the legend.

const HEIGHT = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];
const DEVIATION = ["#08306b", "#2171b5", "#6baed6", "#c6dbef", "#f2f2f2", "#fdc7a7", "#f07a55", "#cb2d2d", "#67000d"];
const SIGMA = ["#fcfbfd", "#dadaeb", "#bcbddc", "#9e9ac8", "#807dba", "#6a51a3", "#54278f", "#3f007d"];
const SCALES = { height: HEIGHT, deviation: DEVIATION, sigma: SIGMA, depth: [...HEIGHT].reverse() };

const parsed = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));

/** 256 colours; with a CSS colour under them that shines through. */
export function table(name, under = null) {
  const paler = ([r, g, b], [pr, pg, pb]) => [0.6 * r + 0.4 * pr, 0.6 * g + 0.4 * pg, 0.6 * b + 0.4 * pb];
  const anchors = SCALES[name].map(parsed).map((colour) => (under ? paler(colour, parsed(under.trim())) : colour));
  const out = new Uint32Array(256);
  for (let k = 0; k < 256; k++) {
    const at = (k / 255) * (anchors.length - 1);
    const n = Math.min(Math.floor(at), anchors.length - 2);
    const [r, g, b] = anchors[n].map((c, m) => Math.round(c + (anchors[n + 1][m] - c) * (at - n)));
    out[k] = ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
  }
  return out;
}

/** A CSS colour as 32-bit RGBA. */
export function packed(css) {
  const [r, g, b] = parsed(css.trim());
  return ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
}

export const variable = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Diagonal lines: what was looked at and not measured. */
export function hatch(context) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = 8;
  const c = tile.getContext("2d");
  c.strokeStyle = variable("--hatch");
  c.lineWidth = 1.4;
  for (const k of [-8, 0, 8]) {
    c.beginPath();
    c.moveTo(k, 8);
    c.lineTo(k + 8, 0);
    c.stroke();
  }
  return context.createPattern(tile, "repeat");
}

/** Millimetres, or micrometres where that reads better. */
export function length(metres, digits = 3) {
  if (!Number.isFinite(metres)) return "–";
  if (Math.abs(metres) < 0.9995e-3) return `${+(metres * 1e6).toPrecision(digits)} µm`;
  return `${+(metres * 1e3).toPrecision(Math.max(digits, 3))} mm`;
}

/** Draw a scale with its two ends. */
export function legend(canvas, name, [low, high]) {
  const c = canvas.getContext("2d");
  const w = canvas.width, colours = table(name);
  const image = c.createImageData(w, 12);
  const pixels = new Uint32Array(image.data.buffer);
  for (let k = 0; k < pixels.length; k++) pixels[k] = colours[Math.floor(((k % w) / w) * 256)];
  c.clearRect(0, 0, w, canvas.height);
  c.putImageData(image, 0, 0);
  c.fillStyle = variable("--ink");
  c.font = "13px system-ui, sans-serif";
  c.textBaseline = "top";
  const ends = [length(low), name, length(high)];
  ["left", "center", "right"].forEach((align, k) => {
    c.textAlign = align;
    c.fillText(ends[k], (w * k) / 2, 16);
  });
}
