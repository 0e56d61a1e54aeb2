// The live charts: one strip a quantity, all over the same time, with a common crosshair.

import { Axes, niceRange, niceStep, palette } from "./axes.js";
import { byId, h, setText } from "../dom.js";
import { duration, number } from "../words.js";

const QUANTITIES = [
  { name: "Position", unit: "µm", value: "x_um", reference: "x_r_um", least: 1,
    decimals: 2, names: true, limits: ["position_min", "position_max"] },
  { name: "Contact force", unit: "mN", value: "force_mN", reference: "force_r_mN",
    half: "force_uncertainty_mN", least: 2, decimals: 2, limits: ["force_max"] },
  { name: "Voltage", unit: "V", value: "voltage_V", least: 0.2, decimals: 3,
    limits: ["voltage_min", "voltage_max"] },
  { name: "Sliding function", unit: "µm", value: "sliding_um", zero: true,
    least: 0.2, decimals: 3, limits: [] },
];
const GAP_S = 0.4;
const OLD_S = 3;
const FRAME_MS = 60;

/** One strip. */
class Strip {
  constructor(quantity, last) {
    this.quantity = quantity;
    this.canvas = h("canvas", { "aria-hidden": "true" });
    this.said = h("output", { class: "strip-said" });
    const keys = [h("span", { class: "key measured" }, quantity.half ? "estimate ± u" : "measured")];
    if (quantity.value === "voltage_V") keys[0].textContent = "applied";
    if (quantity.zero) keys[0].textContent = "of the law";
    if (quantity.reference) keys.push(h("span", { class: "key reference" }, "reference"));
    this.element = h("figure", { class: last ? "strip last" : "strip" },
      h("figcaption", {}, h("b", {}, quantity.name), h("span", { class: "unit" }, quantity.unit),
        ...keys, this.said), this.canvas);
    this.axes = new Axes(this.canvas,
      { top: quantity.names ? 20 : 8, bottom: last ? 24 : 8 });
    this.last = last;
    this.range = [0, quantity.least];
    this.limits = [];
  }

  /** The range of what is seen; it changes only where it is too small or much too large. */
  fit(recent, first) {
    const { value, reference, half, zero, least } = this.quantity;
    let [low, high] = zero ? [0, 0] : [Infinity, -Infinity];
    for (let i = first; i < recent.count; i += 1) {
      const v = recent.value(value, i);
      const u = half ? recent.value(half, i) : 0;
      if (Number.isFinite(v)) [low, high] = [Math.min(low, v - u), Math.max(high, v + u)];
      const r = reference ? recent.value(reference, i) : NaN;
      if (Number.isFinite(r)) [low, high] = [Math.min(low, r), Math.max(high, r)];
    }
    const [from, to] = this.range;
    if (low > high || (low >= from && high <= to && high - low > 0.4 * (to - from))) return;
    this.range = niceRange(low, high, least);
  }

  draw(recent, view, colours) {
    const first = Math.max(0, recent.since(view.from) - 1);
    this.fit(recent, recent.since(view.from));
    const axes = this.axes;
    if (!axes.begin([view.from, view.to], this.range, colours)) return;
    const { value, reference, half } = this.quantity;
    const time = (i) => recent.time(i);
    const of = (name) => (i) => recent.value(name, i);
    const end = recent.since(view.to + 1e-6);
    // The grid stands still beside the newest value; the lines pass over it.
    [axes.from, axes.to] = [-view.seconds, 0];
    axes.grid(niceStep(view.seconds, 6), this.last ? (t) => (t > -1e-6 ? "now" : `${number(t, 0)} s`) : null);
    [axes.from, axes.to] = [view.from, view.to];
    this.phases(recent, Math.min(recent.since(view.from), end), end, colours);
    axes.clip();
    if (this.quantity.zero) axes.level(0, colours.text);
    // A limit far away is out of sight; it widens no chart.
    for (const limit of this.limits) axes.level(limit, colours.limit, [8, 4]);
    if (half) axes.band(first, end, time, of(value), of(half), colours.band, GAP_S);
    if (reference) {
      axes.line(first, end, time, of(reference), colours.reference,
        { dash: [6, 4], width: 1.4, gap: GAP_S });
    }
    axes.line(first, end, time, of(value), colours.measured, { gap: GAP_S });
    if (view.cross !== null) axes.upright(view.cross, colours.ink);
    axes.unclip();
  }

  /** Where one phase ends and the next begins; the first strip names them. */
  phases(recent, first, end, colours) {
    const { axes } = this;
    const bounds = [];
    for (let i = first + 1; i < end; i += 1) {
      if (recent.phase(i) !== recent.phase(i - 1)) bounds.push(i);
    }
    for (const i of bounds) axes.upright(recent.time(i), colours.text, [2, 3]);
    if (!this.quantity.names || first >= end) return;
    axes.names([first, ...bounds].map((i) => [recent.time(i), recent.phase(i)]),
      recent.time(end - 1));
  }
}

/** All strips, what they show, and the newest values as a table. */
export class Charts {
  constructor(recent) {
    this.recent = recent;
    this.view = { seconds: 30, from: -30, to: 0, cross: null, held: null };
    this.strips = QUANTITIES.map((each, place) => new Strip(each, place === QUANTITIES.length - 1));
    byId("charts").append(...this.strips.map((strip) => strip.element));
    this.cells = QUANTITIES.map((each) => this.row(each));
    this.colours = palette();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.colours = palette();
      this.dirty = true;
    });
    new ResizeObserver(() => { this.dirty = true; }).observe(byId("charts"));
    this.drawn = -1;
    this.drawnAt = 0;
    requestAnimationFrame((now) => this.frame(now));
  }

  /** The limits of the rig, drawn where they are in sight. */
  follow(rig) {
    for (const strip of this.strips) {
      strip.limits = rig.limits.filter((each) => strip.quantity.limits.includes(each.quantity))
        .map((each) => each.value);
    }
    this.dirty = true;
  }

  row(quantity) {
    const value = h("span", { class: "figure" }, "–");
    const more = h("span", { class: "more" });
    const reference = h("td", { class: "ref", role: "cell" });
    byId("readouts").append(h("tr", { role: "row" },
      h("th", { scope: "row", role: "rowheader" }, quantity.name),
      h("td", { class: "now", role: "cell" }, value, " ",
        h("span", { class: "unit" }, quantity.unit), more),
      reference));
    return { value, more, reference };
  }

  /** Draw where something has changed, and not too often. */
  frame(now) {
    const changed = this.dirty || this.drawn !== this.recent.version;
    if (changed && now - this.drawnAt >= FRAME_MS && !document.hidden) {
      this.drawn = this.recent.version;
      this.drawnAt = now;
      this.dirty = false;
      this.draw();
    }
    requestAnimationFrame((later) => this.frame(later));
  }

  draw() {
    const { recent, view } = this;
    view.to = view.held ?? recent.now_s ?? 0;
    view.from = view.to - view.seconds;
    if (view.cross !== null && view.cross < view.from) view.cross = null;
    for (const strip of this.strips) strip.draw(recent, view, this.colours);
    this.tell();
  }

  /** The newest values in the table; those under the crosshair beside each strip. */
  tell() {
    const { recent, view } = this;
    const under = view.cross === null ? null : recent.nearest(view.cross);
    for (const [place, each] of QUANTITIES.entries()) {
      const latest = (name) => (name ? recent.latest(name) : NaN);
      const cell = this.cells[place];
      setText(cell.value, number(latest(each.value), each.decimals));
      const half = latest(each.half);
      setText(cell.more, Number.isFinite(half) ? `± ${number(half, 2)}` : "");
      const reference = latest(each.reference);
      setText(cell.reference,
        Number.isFinite(reference) ? `ref ${number(reference, each.decimals)}` : "\u00a0");
      const there = under === null ? NaN : recent.value(each.value, under);
      setText(this.strips[place].said,
        under === null ? "" : `${number(there, each.decimals)} ${each.unit}`);
    }
    setText(byId("at"), under === null ? "" : this.under(under));
    setText(byId("age"), under === null ? this.silence() : "");
  }

  under(index) {
    const { recent, view } = this;
    const phase = recent.phase(index);
    return `${number(recent.time(index) - (view.held ?? recent.now_s), 1)} s${phase ? ` · ${phase}` : ""}`;
  }

  /** Why the charts stand still; empty while samples come. */
  silence() {
    const { recent } = this;
    if (!recent.count) return recent.now_s === null ? "" : "no samples yet";
    const age_s = recent.now_s - recent.time(recent.count - 1);
    return age_s > OLD_S ? `newest sample ${duration(Math.floor(age_s))} ago` : "";
  }
}
