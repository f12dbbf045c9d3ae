// The height map: panning, zooming, findings on it, a profile's line, and the strip below.

import { hatch, length, variable } from "./colours.js";

const VERDICT = { nonconform: "--bad", inconclusive: "--warn", conform: "--good" };
export const colourOf = (finding) => variable(VERDICT[finding.verdict] || "--idle");

export class MapView {
  constructor(canvas, overview, tiles, on) {
    Object.assign(this, { canvas, overview, tiles, on });
    this.scale = 4000; // pixels a metre
    this.centre = [0, 0]; // shown coordinates, metres
    this.following = this.fitted = false;
    this.findings = [];
    this.selected = this.line = this.marked = this.head = null;
    this.drawing = false;
    this.overviewAt = 0;
    this.frames = 0;
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.listen();
    this.resize();
  }

  resize() {
    for (const canvas of [this.canvas, this.overview]) {
      const ratio = window.devicePixelRatio || 1;
      canvas.width = Math.max(2, Math.round(canvas.clientWidth * ratio));
      canvas.height = Math.max(2, Math.round(canvas.clientHeight * ratio));
    }
    if (this.fitted) this.fit();
    this.overviewAt = 0;
    this.draw();
  }

  get ratio() { return this.canvas.width / Math.max(1, this.canvas.clientWidth); }

  toScreen([u, v]) {
    return [(u - this.centre[0]) * this.scale + this.canvas.width / 2, (this.centre[1] - v) * this.scale + this.canvas.height / 2];
  }

  fromScreen([x, y]) {
    return [(x - this.canvas.width / 2) / this.scale + this.centre[0], this.centre[1] - (y - this.canvas.height / 2) / this.scale];
  }

  fit() {
    const box = this.tiles.bounds();
    if (!box) return;
    this.following = false;
    this.fitted = true;
    this.centre = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
    this.scale = 0.96 * Math.min(this.canvas.width / (box[2] - box[0]), this.canvas.height / (box[3] - box[1]));
    this.draw();
  }

  follow(on) {
    this.following = on;
    if (on) {
      this.fitted = false;
      const box = this.tiles.bounds();
      // Some 250 mm in view: at 0.3 m/s what is new stays in it for a second.
      if (box) this.scale = Math.min(this.canvas.width / 0.25, (0.9 * this.canvas.height) / Math.min(box[3] - box[1], 0.25));
      this.keepUp();
    }
    this.draw();
  }

  keepUp() {
    if (this.following && this.head) {
      const [u, v] = this.tiles.shown(this.head);
      const ahead = this.before && u < this.before[0] ? 0.3 : -0.3;
      this.before = [u, v];
      this.centre = [u + (ahead * this.canvas.width) / this.scale, v];
    }
  }

  goTo(finding) {
    if (!finding.at_m) return;
    this.following = this.fitted = false;
    this.centre = this.tiles.shown(finding.at_m);
    const size = Math.max(6 * Math.max(finding.length_m || 0, finding.width_m || 0), 0.015);
    this.scale = Math.min(this.canvas.width, this.canvas.height) / size;
    this.draw();
  }

  zoom(factor, at = [this.canvas.width / 2, this.canvas.height / 2]) {
    const before = this.fromScreen(at);
    this.scale = Math.min(2e6, Math.max(20, this.scale * factor));
    const after = this.fromScreen(at);
    if (!this.following) this.centre = this.centre.map((c, k) => c + before[k] - after[k]);
    this.fitted = false;
    this.draw();
  }

  pan(x, y) {
    this.following = this.fitted = false;
    this.centre = [this.centre[0] - x / this.scale, this.centre[1] + y / this.scale];
    this.draw();
  }

  /** Have it drawn with the next frame of the browser. */
  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.paint();
      this.frames++;
    });
  }

  paint() {
    const { canvas, tiles } = this, c = canvas.getContext("2d");
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = variable("--pane");
    c.fillRect(0, 0, canvas.width, canvas.height);
    this.lines = hatch(c);
    this.paintTiles(c, ([u, v]) => this.toScreen([u, v]), canvas);
    for (const finding of [...this.findings].reverse()) this.paintFinding(c, finding);
    this.labels = [];
    for (const finding of this.findings) this.paintLabel(c, finding);
    if (this.head && this.on.live()) this.paintHead(c);
    if (this.line) this.paintLine(c);
    if (tiles.all.size) this.paintBar(c);
    // The whole strip takes longer; it need not be as often.
    const now = performance.now();
    if (now - this.overviewAt > 1000 || this.overviewVersion !== tiles.version) {
      this.overviewAt = now;
      this.overviewVersion = tiles.version;
      this.strip = this.paintStrip();
    }
    this.paintOverview();
    this.on.view(this);
  }

  paintTiles(c, toScreen, { width, height }) {
    const { tiles } = this;
    c.imageSmoothingEnabled = Math.abs(toScreen([tiles.cell, 0])[0] - toScreen([0, 0])[0]) < 1;
    for (const tile of tiles.all.values()) {
      const [a, b] = tiles.turned ? [tile.j, -tile.i - 1] : [tile.i, tile.j];
      const [x0, y1] = toScreen([a * tiles.edge, b * tiles.edge]).map(Math.round);
      const [x1, y0] = toScreen([(a + 1) * tiles.edge, (b + 1) * tiles.edge]).map(Math.round);
      if (x1 < 0 || y1 < 0 || x0 > width || y0 > height || x1 <= x0 || y1 <= y0) continue;
      c.fillStyle = this.lines;
      c.fillRect(x0, y0, x1 - x0, y1 - y0);
      c.drawImage(tiles.picture(tile), x0, y0, x1 - x0, y1 - y0);
    }
  }

  paintFinding(c, finding) {
    if (!finding.at_m) return;
    const [x, y] = this.toScreen(this.tiles.shown(finding.at_m)), r = this.ratio;
    const chosen = finding === this.selected, worst = finding === this.on.worst();
    const radius = Math.max(9 * r, ((finding.length_m || 0) / 2) * this.scale * 1.3);
    if (x < -radius || y < -radius || x > this.canvas.width + radius || y > this.canvas.height + radius) return;
    c.strokeStyle = colourOf(finding);
    c.lineWidth = (chosen || worst ? 3.5 : 2) * r;
    c.beginPath();
    if (finding.outline_at_m) {
      for (const point of finding.outline_at_m) c.lineTo(...this.toScreen(this.tiles.shown(point)));
      c.closePath();
      c.stroke();
      c.beginPath();
    }
    if (!finding.outline_at_m || chosen || worst) {
      c.arc(x, y, radius, 0, 2 * Math.PI);
      c.stroke();
    }
  }

  /** A finding's name, where the names of worse ones leave room. */
  paintLabel(c, finding) {
    if (!finding.at_m) return;
    const [x, y] = this.toScreen(this.tiles.shown(finding.at_m)), r = this.ratio;
    if (x < 0 || y < 0 || x > this.canvas.width || y > this.canvas.height) return;
    const worst = finding === this.on.worst();
    const radius = Math.max(9 * r, ((finding.length_m || 0) / 2) * this.scale * 1.3);
    const text = worst ? `WORST: ${finding.kind} ${length(Math.abs(finding.depth_m))}` : finding.kind;
    c.font = `${worst ? "bold " : ""}${(worst ? 17 : 13) * r}px system-ui, sans-serif`;
    const width = c.measureText(text).width + 10 * r, tall = (worst ? 24 : 19) * r;
    // Inside the picture, also at its edges.
    const left = Math.max(2, Math.min(x + radius * 0.8, this.canvas.width - width - 2));
    const top = Math.max(2, Math.min(y - radius - tall, this.canvas.height - tall - 2));
    const covers = ([l, t, w, h]) => left < l + w && l < left + width && top < t + h && t < top + tall;
    if (finding !== this.selected && this.labels.some(covers)) return;
    this.labels.push([left, top, width, tall]);
    c.fillStyle = colourOf(finding);
    c.fillRect(left, top, width, tall);
    c.fillStyle = "#fff";
    c.textBaseline = "middle";
    c.textAlign = "left";
    c.fillText(text, left + 5 * r, top + tall / 2);
  }

  paintHead(c) {
    const [x, y] = this.toScreen(this.tiles.shown(this.head)), r = this.ratio;
    c.strokeStyle = variable("--mark");
    c.lineWidth = 2 * r;
    c.beginPath();
    c.moveTo(x, y - 26 * r);
    c.lineTo(x, y + 26 * r);
    c.stroke();
  }

  paintLine(c) {
    const ends = this.line.map((p) => this.toScreen(this.tiles.shown(p))), r = this.ratio;
    for (const [colour, width] of [[variable("--pane"), 5], [variable("--mark"), 2.5]]) {
      c.strokeStyle = c.fillStyle = colour;
      c.lineWidth = width * r;
      c.beginPath();
      c.moveTo(...ends[0]);
      c.lineTo(...ends[1]);
      c.stroke();
      for (const end of ends) {
        c.beginPath();
        c.arc(...end, width * 1.6 * r, 0, 7);
        c.fill();
      }
    }
    if (this.marked) {
      c.fillStyle = variable("--bad");
      c.beginPath();
      c.arc(...this.toScreen(this.tiles.shown(this.marked)), 6 * r, 0, 7);
      c.fill();
    }
  }

  paintBar(c) {
    const r = this.ratio, most = this.canvas.width * 0.2;
    const power = 10 ** Math.floor(Math.log10(most / this.scale));
    const metres = [5, 2, 1].map((k) => k * power).find((l) => l * this.scale <= most) || power;
    const w = metres * this.scale, y = this.canvas.height - 14 * r, x = 14 * r;
    c.fillStyle = variable("--pane");
    c.globalAlpha = 0.85;
    c.fillRect(x - 6 * r, y - 22 * r, Math.max(w, 60 * r) + 12 * r, 32 * r);
    c.globalAlpha = 1;
    c.fillStyle = variable("--ink");
    c.fillRect(x, y, w, 3 * r);
    c.font = `${13 * r}px system-ui, sans-serif`;
    c.textAlign = "left";
    c.textBaseline = "bottom";
    c.fillText(length(metres), x, y - 2 * r);
  }

  /** The whole map, stretched into the strip. */
  paintStrip() {
    const box = this.tiles.bounds(), canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [this.overview.width, this.overview.height];
    if (!box) return null;
    const c = canvas.getContext("2d");
    this.box = box;
    this.paintTiles(c, (p) => this.inStrip(p), canvas);
    return canvas;
  }

  inStrip([u, v]) {
    const [u0, v0, u1, v1] = this.box;
    return [((u - u0) / (u1 - u0)) * this.overview.width, ((v1 - v) / (v1 - v0)) * this.overview.height];
  }

  paintOverview() {
    const c = this.overview.getContext("2d"), r = this.ratio;
    c.clearRect(0, 0, this.overview.width, this.overview.height);
    if (!this.strip || !this.box) return;
    c.drawImage(this.strip, 0, 0, this.overview.width, this.overview.height);
    for (const finding of [...this.findings].reverse()) {
      if (!finding.at_m) continue;
      const [x, y] = this.inStrip(this.tiles.shown(finding.at_m));
      const size = (finding === this.on.worst() ? 8 : 4) * r;
      c.fillStyle = colourOf(finding);
      c.strokeStyle = "#fff";
      c.lineWidth = r;
      c.beginPath();
      c.arc(x, Math.min(Math.max(y, size), this.overview.height - size), size, 0, 7);
      c.fill();
      c.stroke();
    }
    const [x0, y0] = this.inStrip(this.fromScreen([0, 0]));
    const [x1, y1] = this.inStrip(this.fromScreen([this.canvas.width, this.canvas.height]));
    c.strokeStyle = variable("--mark");
    c.lineWidth = 2 * r;
    c.strokeRect(Math.max(1, x0), Math.max(1, y0), Math.min(this.overview.width - 1, x1) - Math.max(1, x0), Math.min(this.overview.height - 1, y1) - Math.max(1, y0));
  }

  listen() {
    const { canvas } = this;
    const at = (event) => [event.offsetX * this.ratio, event.offsetY * this.ratio];
    const place = (event) => this.tiles.place(this.fromScreen(at(event)));
    let last = null, moved = 0;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      last = at(event);
      moved = 0;
      this.tracing = this.drawing || event.shiftKey;
      if (this.tracing) this.line = [place(event), place(event)];
    });
    canvas.addEventListener("pointermove", (event) => {
      this.on.cursor(place(event));
      if (!last) return;
      const now = at(event), [dx, dy] = [now[0] - last[0], now[1] - last[1]];
      moved += Math.abs(dx) + Math.abs(dy);
      last = now;
      if (this.tracing) {
        this.line[1] = place(event);
        this.on.line(this.line);
        this.draw();
      } else this.pan(dx, dy);
    });
    canvas.addEventListener("pointerup", (event) => {
      last = null;
      if (moved < 4) {
        if (this.tracing) this.line = null;
        const found = this.nearest(at(event));
        if (found) this.on.select(found);
        this.draw();
      }
    });
    canvas.addEventListener("pointerleave", () => this.on.cursor(null));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * 0.0015), at(event));
    }, { passive: false });
    this.overview.addEventListener("click", (event) => {
      if (!this.box) return;
      const [u0, v0, u1, v1] = this.box;
      this.following = this.fitted = false;
      this.centre = [u0 + (event.offsetX / this.overview.clientWidth) * (u1 - u0), v1 - (event.offsetY / this.overview.clientHeight) * (v1 - v0)];
      this.draw();
    });
  }

  nearest([x, y]) {
    let best = null, least = 24 * this.ratio;
    for (const finding of this.findings) {
      if (!finding.at_m) continue;
      const [a, b] = this.toScreen(this.tiles.shown(finding.at_m));
      const far = Math.hypot(a - x, b - y);
      if (far < least) [best, least] = [finding, far];
    }
    return best;
  }
}
