// The map's tiles: values as they came, and pictures of them made when they are needed.

import { packed, table, variable } from "./colours.js";

const UNMEASURED = 1, CONTINUED = 2;

export class Tiles {
  constructor() {
    this.clear("");
  }

  clear(epoch) {
    this.epoch = epoch;
    this.revision = -1;
    this.all = new Map();
    this.layers = [];
    this.cell = 1e-4;
    this.size = 64;
    this.layer = this.layer || "height";
    this.turned = this.turned || false;
    this.range = [0, 1];
    this.version = (this.version || 0) + 1;
  }

  get edge() { return this.cell * this.size; }

  /** Take an answer of /api/map. */
  take({ header, buffer, offset }) {
    if (header.epoch !== this.epoch) this.clear(header.epoch);
    Object.assign(this, { revision: header.revision, cell: header.cell_m, size: header.tile, layers: header.layers });
    const cells = this.size * this.size;
    for (const [i, j] of header.tiles) {
      const values = {};
      for (const name of header.layers) {
        values[name] = new Float32Array(buffer.slice(offset, offset + 4 * cells));
        offset += 4 * cells;
      }
      const state = new Uint8Array(buffer.slice(offset, offset + cells));
      offset += cells;
      const old = this.all.get(`${i},${j}`);
      this.all.set(`${i},${j}`, { i, j, values, state, picture: old && old.picture, drawn: -1 });
    }
    this.updateRange();
  }

  /** Colours between the 2nd and the 98th percentile of what was measured. */
  updateRange() {
    const sample = [];
    for (const tile of this.all.values()) {
      const values = tile.values[this.layer];
      if (!values) continue;
      for (let k = 0, n = 0; k < values.length && n < 40; k += 37) {
        if (tile.state[k] >= CONTINUED && Number.isFinite(values[k])) sample.push(values[k]), n++;
      }
    }
    if (!sample.length) return;
    sample.sort((a, b) => a - b);
    let low = sample[Math.floor(sample.length * 0.02)], high = sample[Math.floor((sample.length - 1) * 0.98)];
    if (this.layer === "deviation") [low, high] = [-2, 2].map((s) => s * Math.max(Math.abs(low), Math.abs(high), 1e-5)); // noise stays pale
    if (this.layer === "sigma") low = 0;
    if (high - low < 1e-5) [low, high] = [low - 5e-6, high + 5e-6];
    const span = this.range[1] - this.range[0];
    // Not for every new point: all pictures would have to be made again.
    if (Math.abs(low - this.range[0]) > 0.05 * span || Math.abs(high - this.range[1]) > 0.05 * span || span > 1.3 * (high - low)) {
      this.range = [low, high];
      this.version++;
    }
  }

  show(layer) {
    this.layer = layer;
    this.range = [0, 1];
    this.version++;
    this.updateRange();
  }

  turn(turned) {
    this.turned = turned;
    this.version++;
  }

  restyle() { this.version++; }

  /** Picture of a tile; opaque outside, empty where nothing was measured. */
  picture(tile) {
    if (tile.drawn === this.version) return tile.picture;
    if (this.styled !== this.version) {
      this.styled = this.version;
      this.sure = table(this.layer);
      this.continued = table(this.layer, variable("--pale"));
      this.outside = packed(variable("--pane"));
    }
    const n = this.size;
    if (!tile.picture) {
      tile.picture = document.createElement("canvas");
      tile.picture.width = tile.picture.height = n;
    }
    const context = tile.picture.getContext("2d");
    const image = context.createImageData(n, n);
    const pixels = new Uint32Array(image.data.buffer);
    const { state } = tile, values = tile.values[this.layer];
    const [low, high] = this.range, scale = 255 / (high - low);
    for (let j = 0, k = 0; j < n; j++) {
      for (let i = 0; i < n; i++, k++) {
        const s = state[k];
        let colour = 0;
        if (s === 0) colour = this.outside;
        else if (s > UNMEASURED && values) {
          const value = (values[k] - low) * scale;
          if (value === value) colour = (s === CONTINUED ? this.continued : this.sure)[value < 0 ? 0 : value > 255 ? 255 : value | 0];
        }
        pixels[this.turned ? i * n + j : (n - 1 - j) * n + i] = colour;
      }
    }
    context.putImageData(image, 0, 0);
    tile.drawn = this.version;
    return tile.picture;
  }

  /** Values of all layers and the state at a place, metres; null where there is no tile. */
  at(x, y) {
    const i = Math.floor(x / this.cell), j = Math.floor(y / this.cell), n = this.size;
    const tile = this.all.get(`${Math.floor(i / n)},${Math.floor(j / n)}`);
    if (!tile) return null;
    const k = (j - tile.j * n) * n + (i - tile.i * n);
    const out = { state: tile.state[k] };
    for (const name of this.layers) out[name] = tile.values[name] ? tile.values[name][k] : NaN;
    return out;
  }

  /** Least u, v and greatest u, v as shown, metres. */
  bounds() {
    let box = null;
    for (const { i, j } of this.all.values()) {
      const [u, v] = this.turned ? [j, -i - 1] : [i, j];
      box = box ? [Math.min(box[0], u), Math.min(box[1], v), Math.max(box[2], u + 1), Math.max(box[3], v + 1)] : [u, v, u + 1, v + 1];
    }
    return box && box.map((value) => value * this.edge);
  }

  /** From the map's coordinates to those that are shown, and back. */
  shown([x, y]) { return this.turned ? [y, -x] : [x, y]; }

  place([u, v]) { return this.turned ? [-v, u] : [u, v]; }
}
