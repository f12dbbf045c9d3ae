// The list of findings, worst first, filtered by verdict and kind.

import { length } from "./colours.js";

const $ = (selector) => document.querySelector(selector);
const element = (name, className, text) => Object.assign(document.createElement(name), { className, textContent: text });

/** Fill a list anew; an item that has the keyboard keeps it. `act` is for a click and Enter. */
export function refill(list, items) {
  const held = list.contains(document.activeElement) ? document.activeElement.dataset.key : null;
  list.replaceChildren(...items.map(([key, act, item]) => {
    item.dataset.key = key;
    item.tabIndex = 0;
    item.addEventListener("click", act);
    item.addEventListener("keydown", (event) => event.key === "Enter" && act());
    return item;
  }));
  const again = held === null ? null : [...list.children].find((item) => item.dataset.key === held);
  if (again) again.focus({ preventScroll: true });
}

/** What a finding is in words. */
export function described(finding) {
  const size = [finding.length_m, finding.width_m].filter(Number.isFinite).map((v) => length(v)).join(" × ");
  const known = (finding.uncertainty || {}).depth_m;
  const deep = Number.isFinite(finding.depth_m)
    ? `${length(Math.abs(finding.depth_m))} ${finding.depth_m < 0 ? "deep" : "high"}${Number.isFinite(known) ? ` ± ${length(known, 2)}` : ""}` : "";
  return { deep, size };
}

export class Findings {
  constructor(onSelect, onChange) {
    Object.assign(this, { onSelect, onChange, all: [], selected: null });
    for (const id of ["#by-verdict", "#by-kind"]) $(id).addEventListener("change", () => this.render());
    $("#worst").addEventListener("click", () => this.worst && this.select(this.worst));
  }

  get worst() { return this.all[0] || null; }

  /** Take the whole list; what was chosen stays chosen. */
  take(list) {
    const chosen = this.selected && this.selected.id;
    this.all = list;
    this.selected = list.find((f) => f.id === chosen) || null;
    this.choices("#by-verdict", "every verdict", "verdict");
    this.choices("#by-kind", "every kind", "kind");
    this.render();
  }

  choices(id, every, key) {
    const before = $(id).value, values = [...new Set(this.all.map((f) => f[key]).filter(Boolean))];
    $(id).replaceChildren(new Option(every, ""), ...values.map((v) => new Option(v, v)));
    $(id).value = values.includes(before) ? before : "";
  }

  get shown() {
    const [verdict, kind] = [$("#by-verdict").value, $("#by-kind").value];
    return this.all.filter((f) => (!verdict || f.verdict === verdict) && (!kind || f.kind === kind));
  }

  select(finding, jump = true) {
    this.selected = finding;
    this.render();
    const item = document.querySelector('#findings li[aria-selected="true"]');
    if (item) {  // in the list alone: on a phone the verdict above it must stay
      const list = item.parentElement, at = item.getBoundingClientRect(), box = list.getBoundingClientRect();
      list.scrollTop += Math.min(at.top - box.top, 0) || Math.max(at.bottom - box.bottom, 0);
    }
    this.onSelect(finding, jump);
  }

  step(by) {
    const shown = this.shown, at = shown.indexOf(this.selected);
    if (shown.length) this.select(shown[(at + by + shown.length) % shown.length]);
  }

  render() {
    const { shown, all } = this;
    $("#findings-count").textContent = all.length ? (shown.length < all.length ? `${shown.length} of ${all.length}` : all.length) : "none";
    $("#filters").hidden = all.length < 2;
    // A list of thousands would take seconds to lay out.
    refill($("#findings ol"), shown.slice(0, 500).map((finding) => {
      const item = document.createElement("li"), { deep, size } = described(finding);
      item.dataset.verdict = finding.verdict;
      item.setAttribute("aria-selected", finding === this.selected);
      item.append(element("b", "", `${finding.kind} ${deep}`.trim()), " ", element("span", "chip", finding.verdict || "?"), document.createElement("br"),
        element("span", "small", [`#${finding.id}`, size, finding.limit, Number.isFinite(finding.confidence) ? `sure to ${Math.round(finding.confidence * 100)} %` : ""].filter(Boolean).join(" · ")));
      return [finding.id, () => this.select(finding), item];
    }));
    this.renderWorst();
    this.onChange(shown);
  }

  renderWorst() {
    const banner = $("#worst"), worst = this.worst;
    banner.hidden = !worst;
    if (!worst) return;
    const { deep, size } = described(worst);
    banner.dataset.verdict = worst.verdict;
    const bad = this.all.filter((f) => f.verdict === "nonconform").length;
    banner.replaceChildren(element("span", "small", "worst finding"), element("b", "", [worst.kind, deep, size].filter(Boolean).join(", ")),
      element("span", "chip", worst.verdict || "?"), element("span", "small", `${bad} of ${all(this.all.length)} nonconform; click: show it`));
  }
}

const all = (count) => `${count} finding${count === 1 ? "" : "s"}`;
