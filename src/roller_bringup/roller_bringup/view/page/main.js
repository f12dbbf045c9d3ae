// Puts the page together.

import { legend, length } from "./colours.js";
import { follow } from "./feed.js";
import { Findings } from "./findings.js";
import { MapView } from "./map.js";
import { showDepth, showFiles, showOffline, showState, showText } from "./panels.js";
import { Profile } from "./profile.js";
import { Tiles } from "./tiles.js";

const $ = (selector) => document.querySelector(selector);
const STATES = ["outside", "not measured", "continued from neighbours", "measured"];

const tiles = new Tiles();
let state = null, placed = false, cursor = null, frames = 0;

const findings = new Findings(
  (finding, jump) => {
    map.selected = finding;
    if (jump) map.goTo(finding);
    map.draw();
  },
  (shown) => {
    if (!map) return;
    map.findings = shown;
    map.draw();
  });
const map = new MapView($("#map"), $("#overview"), tiles, {
  live: () => state && state.live,
  worst: () => findings.worst,
  cursor: (place) => { cursor = place; readOut(); },
  line: (line) => profile.show(line),
  select: (finding) => findings.select(finding, false),
  view: () => {
    press("#follow", map.following);
    press("#fit", map.fitted);
    press("#profile-tool", map.drawing);
  },
});
const profile = new Profile(tiles, (place) => { map.marked = place; map.draw(); }, () => closeProfile());

const press = (id, on) => $(id).setAttribute("aria-pressed", Boolean(on));

function closeProfile() {
  map.line = map.marked = null;
  map.drawing = false;
  $("#map").classList.remove("drawing");
  profile.show(null);
  map.draw();
}

function readOut() {
  const found = cursor && tiles.at(...cursor);
  if (!found || !state || !found.state) { $("#readout").textContent = ""; return; }
  const [x, y] = cursor, m = state.base_from_map;
  const z = found.state > 1 && Number.isFinite(found.height) ? found.height : 0;
  const base = [0, 1, 2].map((k) => m[k][0] * x + m[k][1] * y + m[k][2] * z + m[k][3]);
  const values = tiles.layers.filter((name) => found.state > 1 && Number.isFinite(found[name])).map((name) => `${name} ${length(found[name], 4)}`);
  $("#readout").textContent = [`base x ${(base[0] * 1e3).toFixed(2)}, y ${(base[1] * 1e3).toFixed(2)} mm`, ...values, STATES[found.state]].join(" · ");
}

function showLayers() {
  const names = tiles.layers.length ? tiles.layers : ["height"];
  if ($("#layers").childElementCount !== names.length) {
    $("#layers").replaceChildren(...names.map((name) => {
      const button = document.createElement("button");
      button.textContent = name[0].toUpperCase() + name.slice(1);
      button.dataset.layer = name;
      button.addEventListener("click", () => showLayer(name));
      return button;
    }));
  }
  for (const button of $("#layers").children) button.setAttribute("aria-pressed", button.dataset.layer === tiles.layer);
  $("#legend").style.visibility = tiles.bounds() ? "" : "hidden";  // a range of nothing says nothing
  legend($("#legend"), tiles.layer, tiles.range);
}

function showLayer(name) {
  if (!tiles.layers.includes(name)) return;
  tiles.show(name);
  refresh();
}

function refresh() {
  showLayers();
  if (profile.line) profile.show(profile.line);
  map.draw();
}

/** What is seen first: all of it, or of a long strip the worst place; live the roller. */
function place() {
  const box = tiles.bounds();
  if (!box || placed || !state) return;
  placed = true;
  const [w, h] = [box[2] - box[0], box[3] - box[1]];
  if (h > 1.5 * w) tiles.turn(true);
  if (state.live) map.follow(true);
  else {
    map.fit();
    if (findings.worst) findings.select(findings.worst, Math.max(w / h, h / w) > 8);
  }
}

follow(tiles, {
  state: (found) => {
    state = found;
    map.head = found.map.head;
    map.keepUp();
    showState(found);
    $("#follow").hidden = !found.live;
    // A live page shows findings only where something looks for them.
    $("#findings").hidden = found.live && !findings.all.length;
    frames += 1;
    map.draw();
  },
  tiles: () => {
    $("#empty").hidden = tiles.all.size > 0;
    place();
    if (map.fitted) map.fit();
    refresh();
  },
  depth: showDepth,
  text: showText,
  findings: (list) => {
    findings.take(list);
    if (placed && !state.live && !findings.selected && findings.worst) placed = false;
    place();
  },
  files: showFiles,
  offline: showOffline,
});

function theme(next) {
  if (next) localStorage.setItem("theme", next);
  const chosen = localStorage.getItem("theme");
  if (chosen) document.documentElement.dataset.theme = chosen;
  tiles.restyle();
  refresh();
}

function otherTheme() {
  const now = document.documentElement.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  theme(now === "dark" ? "light" : "dark");
}

function useProfile() {
  map.drawing = !map.drawing;
  $("#map").classList.toggle("drawing", map.drawing);
  map.draw();
}

const KEYS = {
  n: () => findings.step(1), b: () => findings.step(-1),
  0: () => map.fit(), f: () => map.follow(!map.following),
  "+": () => map.zoom(1.4), "=": () => map.zoom(1.4), "-": () => map.zoom(1 / 1.4),
  ArrowLeft: () => map.pan(120, 0), ArrowRight: () => map.pan(-120, 0), ArrowUp: () => map.pan(0, 120), ArrowDown: () => map.pan(0, -120),
  h: () => showLayer("height"), d: () => showLayer("deviation"), s: () => showLayer("sigma"),
  p: useProfile, Escape: closeProfile, l: otherTheme, "?": () => $("#keys").showModal(),
  r: () => { tiles.turn(!tiles.turned); map.fit(); },
};
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select, input")) return;
  const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (act) { event.preventDefault(); act(); }
});
$("#fit").addEventListener("click", () => map.fit());
$("#follow").addEventListener("click", () => map.follow(!map.following));
$("#profile-tool").addEventListener("click", useProfile);
$("#theme").addEventListener("click", otherTheme);
$("#help").addEventListener("click", () => $("#keys").showModal());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => theme());
theme();
/** How often it was painted, and frames that came: for who measures it. */
window.rollerPainted = () => [map.frames, frames];
