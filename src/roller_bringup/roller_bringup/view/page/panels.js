// Big state, figures, health, depth, text and files.

import { hatch, length, table } from "./colours.js";
import { refill } from "./findings.js";

const $ = (selector) => document.querySelector(selector);
const element = (name, className, text) => Object.assign(document.createElement(name), { className, textContent: text });
const number = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits) : null);

function figures(state) {
  const cover = state.coverage || {}, rate = state.event_rate_per_s;
  const measured = cover.measured;
  const rows = [
    ["speed", number(state.speed_m_s, 2), "m/s"],
    ["force", number(state.force_n, 1), "N"],
    ["events", Number.isFinite(rate) ? (rate / 1e6).toFixed(2) : null, "Mev/s"],
    ["lag", number(state.lag_s, 2), "s"],
    [cover.cell_m ? `measured, of cells of ${length(cover.cell_m)}` : "measured", Number.isFinite(measured) ? (100 * measured).toFixed(measured < 0.1 ? 1 : 0) : null, "%"],
    ["continued", Number.isFinite(cover.continued) ? (100 * cover.continued).toFixed(0) : null, "%"],
    ["unmeasured", Number.isFinite(cover.unmeasured) ? (100 * cover.unmeasured).toFixed(0) : null, "%"],
  ];
  // A live page keeps its places; a result has what it has.
  return rows.filter(([name, value]) => value !== null || (state.live && ["speed", "events", "lag"].includes(name)));
}

export function showState(state) {
  $("#top").dataset.level = state.big.level;
  $("#word").textContent = state.big.word;
  $("#detail").textContent = state.big.detail;
  $("#title").textContent = state.title;
  document.title = `${state.big.word} · ${state.title}`;
  $("#figures").replaceChildren(...figures(state).map(([name, value, unit]) => {
    const box = document.createElement("div"), dd = element("dd", "", value === null ? "–" : `${value} `);
    if (value !== null) dd.append(element("small", "", unit));
    box.append(element("dt", "", name), dd);
    return box;
  }));
  showNodes(state.nodes);
  const facts = Object.entries(state.facts);
  $("#facts").hidden = !facts.length;
  $("#facts ul").replaceChildren(...facts.map(([name, value]) => element("li", "", `${name}: ${value}`)));
  const foot = [`${state.map.points ? `${state.map.points.toLocaleString("en")} points · ` : ""}cells of ${length(state.map.cell_m)} · ${state.viewers} looking on · ${state.dropped_frames} frames dropped for slow browsers`];
  $("#foot").replaceChildren(...foot, ...state.notes.map((note) => element("div", "fault", note)));
}

const open = new Set();

function showNodes(nodes) {
  $("#nodes").hidden = !nodes.length;
  const order = ["bad", "gone", "warn", "good", "idle"];
  const sorted = [...nodes].sort((a, b) => order.indexOf(a.level) - order.indexOf(b.level) || a.name.localeCompare(b.name));
  refill($("#nodes ul"), sorted.map((node) => {
    const item = document.createElement("li");
    item.dataset.level = node.level;
    item.title = "click or Enter: its figures";
    item.append(element("b", "", node.name), ` ${node.message}`);
    if (node.advice) item.append(element("div", "advice", `→ ${node.advice}`));
    if (open.has(node.name)) {
      const rows = Object.entries(node.values).map(([key, value]) => {
        const row = document.createElement("tr");
        row.append(element("td", "", key), element("td", "", value));
        return row;
      });
      const figures = document.createElement("table");
      figures.append(...rows);
      item.append(figures);
    }
    const turn = () => {
      open.delete(node.name) || open.add(node.name);
      showNodes(nodes);
    };
    return [node.name, turn, item];
  }));
}

export function showOffline() {
  $("#top").dataset.level = "bad";
  $("#word").textContent = "NO SERVER";
  $("#detail").textContent = "what is shown is old; trying again every second. Does `roller view` still run?";
}

export function showDepth({ header, buffer, offset }) {
  $("#depth").hidden = !header.revision;
  $("#depth-range").textContent = `${length(header.low_m, 4)} (near) to ${length(header.high_m, 4)}`;
  const canvas = $("#depth canvas"), c = canvas.getContext("2d"), colours = table("depth");
  [canvas.width, canvas.height] = [header.width, header.height];
  const values = new Uint8Array(buffer, offset), image = c.createImageData(header.width, header.height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let k = 0; k < values.length; k++) pixels[k] = values[k] ? colours[values[k]] : 0;
  const picture = document.createElement("canvas");
  [picture.width, picture.height] = [header.width, header.height];
  picture.getContext("2d").putImageData(image, 0, 0);
  c.fillStyle = hatch(c);
  c.fillRect(0, 0, canvas.width, canvas.height);
  c.drawImage(picture, 0, 0);
}

export function showText(text) {
  const pre = $("#text pre");
  $("#text").hidden = !text.trim();
  pre.textContent = text;
  pre.scrollTop = pre.scrollHeight;
}

const size = (bytes) => (bytes < 1e6 ? `${Math.max(1, Math.round(bytes / 1e3))} kB` : `${(bytes / 1e6).toFixed(1)} MB`);

export function showFiles(files) {
  $("#files").hidden = !files.length;
  $("#files ul").replaceChildren(...files.map(({ name, bytes }) => {
    const item = document.createElement("li"), link = element("a", "", name);
    link.href = `/files/${name.split("/").map(encodeURIComponent).join("/")}`;
    link.target = "_blank";
    link.rel = "noopener";
    item.append(link, element("span", "small", ` ${size(bytes)}`));
    return item;
  }));
}
