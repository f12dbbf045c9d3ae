// A profile along a line over the map.

import { hatch, length, variable } from "./colours.js";

const $ = (selector) => document.querySelector(selector);
const SAMPLES = 600, MEASURED = 3;

export class Profile {
  constructor(tiles, onMark, onClose) {
    Object.assign(this, { tiles, onMark, line: null });
    const canvas = $("#profile-chart");
    canvas.addEventListener("pointermove", (event) => this.point(event.offsetX / canvas.clientWidth));
    canvas.addEventListener("pointerleave", () => this.point(null));
    $("#profile-close").addEventListener("click", onClose);
  }

  show(line) {
    this.line = line;
    $("#profile").hidden = !line;
    if (line) this.sample(), this.draw();
  }

  /** Values along the line; NaN where there are none. */
  sample() {
    const [a, b] = this.line;
    this.metres = Math.hypot(b[0] - a[0], b[1] - a[1]);
    this.name = this.tiles.layer;
    this.values = new Float64Array(SAMPLES).fill(NaN);
    this.state = new Uint8Array(SAMPLES);
    for (let k = 0; k < SAMPLES; k++) {
      const t = (k + 0.5) / SAMPLES;
      const found = this.tiles.at(a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]));
      if (found && found.state > 1 && Number.isFinite(found[this.name])) this.values[k] = found[this.name];
      this.state[k] = found ? found.state : 0;
    }
  }

  point(share) {
    this.cursor = share === null ? null : Math.min(SAMPLES - 1, Math.max(0, Math.round((share * this.width - this.left) / (this.width - this.left - this.right) * SAMPLES)));
    const [a, b] = this.line || [null, null];
    const t = (this.cursor + 0.5) / SAMPLES;
    this.onMark(share === null || !a ? null : [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
    this.draw();
  }

  draw() {
    const canvas = $("#profile-chart"), r = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * r;
    canvas.height = canvas.clientHeight * r;
    const c = canvas.getContext("2d"), w = canvas.width, h = canvas.height;
    const left = (this.left = 74 * r), right = (this.right = 10 * r), top = 8 * r, bottom = 22 * r;
    this.width = w;
    const known = [...this.values].filter(Number.isFinite);
    c.font = `${12 * r}px system-ui, sans-serif`;
    c.fillStyle = variable("--soft");
    if (!known.length) {
      c.fillText("nothing was measured along this line", left, h / 2);
      $("#profile-text").textContent = length(this.metres);
      return;
    }
    let [low, high] = [Math.min(...known), Math.max(...known)];
    const margin = Math.max((high - low) * 0.08, 2e-6);
    [low, high] = [low - margin, high + margin];
    const x = (k) => left + (k / SAMPLES) * (w - left - right);
    const y = (value) => top + ((high - value) / (high - low)) * (h - top - bottom);
    c.fillStyle = hatch(c);
    for (let k = 0; k < SAMPLES; k++) if (!Number.isFinite(this.values[k])) c.fillRect(x(k), top, x(1) - x(0) + 0.5, h - top - bottom);
    c.strokeStyle = variable("--line");
    c.fillStyle = variable("--soft");
    c.textBaseline = "middle";
    c.textAlign = "right";
    for (let n = 0; n <= 4; n++) {
      const value = low + ((high - low) * n) / 4;
      c.beginPath();
      c.moveTo(left, y(value));
      c.lineTo(w - right, y(value));
      c.stroke();
      c.fillText(length(value), left - 6 * r, y(value));
    }
    c.textBaseline = "bottom";
    for (let n = 0; n <= 5; n++) {
      c.textAlign = n === 5 ? "right" : "center";
      c.fillText(length((this.metres * n) / 5), x((SAMPLES * n) / 5), h - 3 * r);
    }
    c.strokeStyle = variable("--mark");
    c.fillStyle = variable("--mark");
    // Pale what was continued from neighbours, over it what was measured.
    for (const [least, width, opacity] of [[0, 1, 0.45], [MEASURED, 2.5, 1]]) {
      c.lineWidth = width * r;
      c.globalAlpha = opacity;
      c.beginPath();
      let pen = false;
      for (let k = 0; k < SAMPLES; k++) {
        const value = this.values[k];
        if (!Number.isFinite(value) || this.state[k] < least) { pen = false; continue; }
        if (pen) c.lineTo(x(k), y(value));
        else c.moveTo(x(k), y(value)), c.fillRect(x(k) - (width * r) / 2, y(value) - (width * r) / 2, width * r, width * r);
        pen = true;
      }
      c.stroke();
    }
    c.globalAlpha = 1;
    const share = (count) => Math.round((100 * count) / SAMPLES);
    const measured = this.values.filter((value, k) => Number.isFinite(value) && this.state[k] === MEASURED).length;
    let text = `${this.name} over ${length(this.metres)}: from ${length(Math.min(...known))} to ${length(Math.max(...known))}, ${share(measured)} % measured`;
    if (known.length > measured) text += `, ${share(known.length - measured)} % continued (pale)`;
    if (this.cursor !== null && this.cursor !== undefined) {
      const k = this.cursor;
      c.strokeStyle = variable("--bad");
      c.lineWidth = r;
      c.beginPath();
      c.moveTo(x(k), top);
      c.lineTo(x(k), h - bottom);
      c.stroke();
      text = `at ${length((this.metres * k) / SAMPLES)}: ${Number.isFinite(this.values[k]) ? length(this.values[k], 4) : "not measured"}`;
      if (Number.isFinite(this.values[k]) && this.state[k] < MEASURED) text += ", continued from neighbours";
    }
    $("#profile-text").textContent = text;
  }
}
