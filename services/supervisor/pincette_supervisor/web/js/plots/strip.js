// One quantity over time, and its newest value.

import { h, setText } from "../dom.js";
import { number } from "../words.js";
import { Axes, niceRange, niceStep } from "./axes.js";

/** The quantities that are shown, in the order of the page.
 * `shows`: shown among the values or among the errors only. `tolerance`: the tolerance that a job may
 * state. `arms`: shown for rigs with this many arms only; the records of hours have the first arm only.
 * `second`: the same quantity of arm 2, drawn in the same chart. `drawnIn`: the chart that draws this
 * quantity, which has no chart of its own. */
export const QUANTITIES = [
  { name: "Position", unit: "µm", value: "x_um", second: "second_x_um", reference: "x_r_um", least: 1,
    decimals: 2, limits: ["position_min", "position_max"], shows: "values" },
  { name: "Position, arm 2", unit: "µm", value: "second_x_um", least: 1, decimals: 2, limits: [],
    shows: "values", arms: 2, drawnIn: "x_um" },
  { name: "Contact force", unit: "mN", value: "force_mN", second: "second_force_mN",
    reference: "force_r_mN", half: "force_uncertainty_mN", least: 2, decimals: 2,
    limits: ["force_max"], shows: "values" },
  { name: "Contact force, arm 2", unit: "mN", value: "second_force_mN", reference: "force_r_mN",
    least: 2, decimals: 2, limits: [], shows: "values", arms: 2, drawnIn: "force_mN" },
  { name: "Position error", unit: "µm", value: "x_error_um", least: 0.2, decimals: 3, zero: true,
    key: "measured − reference", limits: [], tolerance: "position_tolerance_um", shows: "errors" },
  { name: "Force error", unit: "mN", value: "force_error_mN", half: "force_uncertainty_mN", least: 0.5,
    decimals: 2, zero: true, key: "estimate − reference, ± u", limits: [],
    tolerance: "force_tolerance_mN", shows: "errors" },
  { name: "Place", unit: "µm", value: "place_um", reference: "place_r_um", least: 1, decimals: 2,
    limits: [], shows: "values", arms: 2 },
  { name: "Place error", unit: "µm", value: "place_error_um", least: 0.2, decimals: 3, zero: true,
    key: "measured − reference", limits: [], shows: "errors", arms: 2 },
  { name: "Difference of both forces", unit: "mN", value: "apart_mN", least: 0.5, decimals: 2,
    zero: true, key: "arm 1 − arm 2", limits: [], shows: "errors", arms: 2 },
  { name: "Voltage", unit: "V", value: "voltage_V", second: "second_voltage_V", least: 0.2,
    decimals: 3, key: "applied", limits: ["voltage_min", "voltage_max"] },
  { name: "Voltage, arm 2", unit: "V", value: "second_voltage_V", least: 0.2, decimals: 3, limits: [],
    arms: 2, drawnIn: "voltage_V" },
  { name: "Sliding function", unit: "µm", value: "sliding_um", zero: true, least: 0.2, decimals: 3,
    key: "of the law", limits: [], expert: true },
];
const GAP_S = 0.4;
const JOBS_MARKED = 40;
const STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 14400, 21600];
const MARK_PX = 64;

/** Between two marks of the time; a narrow chart has fewer, whose words do not touch. */
function timeStep(seconds, width) {
  const marks = Math.max(2, Math.min(7, Math.floor(width / MARK_PX)));
  if (seconds < marks) return niceStep(seconds, marks);
  return STEPS.find((step) => seconds / step <= marks) ?? 86400;
}

/** Offset of the local time from UTC, in s. */
const offset_s = (at_s) => -60 * new Date(1000 * at_s).getTimezoneOffset();

/** Hours and minutes of a local time, in s; with seconds, or seconds alone, where marks are so near. */
function timeOfDay(local_s, step_s) {
  if (step_s < 1) return `${number(local_s % 60, step_s < 0.1 ? 2 : 1)} s`;
  return new Date(1000 * Math.round(local_s)).toISOString().slice(11, step_s < 60 ? 19 : 16);
}

export class Strip {
  constructor(quantity) {
    this.quantity = quantity;
    this.canvas = h("canvas", { "aria-hidden": "true" });
    this.said = h("output", { class: "strip-said" });
    this.key = quantity.key ?? (quantity.half ? "estimate ± u" : "measured");
    this.measured = h("span", { class: "key measured" }, this.key);
    this.other = h("span", { class: "key second", hidden: true }, "arm 2");
    const keys = [this.measured, this.other];
    if (quantity.reference) keys.push(h("span", { class: "key reference" }, "reference"));
    this.within = h("span", { class: "key zone", hidden: true });
    this.element = h("figure", { class: "strip", "data-quantity": quantity.value },
      h("figcaption", {}, h("b", {}, quantity.name), h("span", { class: "unit" }, quantity.unit),
        ...keys, this.within, this.said), this.canvas);
    this.axes = new Axes(this.canvas);
    this.range = [0, quantity.least];
    this.limits = [];
    this.tolerance = null;
  }

  /** Prepare the chart: the first one names the phases, the last has the time below it, and with `both`
   * it draws arm 2 as well. */
  settle({ first, last, both }) {
    const { second, half } = this.quantity;
    this.second = both ? second : undefined;
    this.other.hidden = !this.second;
    setText(this.measured, this.second ? `arm 1${half ? " ± u" : ""}` : this.key);
    this.first = first;
    this.last = last;
    this.axes.top = first ? 20 : 8;
    this.axes.bottom = last ? 24 : 8;
    this.element.classList.toggle("last", last);
  }

  /** What is to be seen at a point: the value, or in hours the smallest and the largest. */
  ends(source, i) {
    const { value, half } = this.quantity;
    if (source.envelope) return [source.bound("low", value, i), source.bound("high", value, i)];
    const v = source.value(value, i);
    const u = half ? source.value(half, i) : 0;
    return [v - u, v + u];
  }

  /** The range of what is seen; it changes only where it is too small or much too large. */
  fit(source, first) {
    const { reference, zero, least } = this.quantity;
    let [low, high] = zero ? [0, 0] : [Infinity, -Infinity];
    if (this.tolerance !== null) [low, high] = [-1.2 * this.tolerance, 1.2 * this.tolerance];
    for (let i = first; i < source.count; i += 1) {
      const others = [reference, this.second].map((name) => (name ? source.value(name, i) : NaN));
      for (const v of [...this.ends(source, i), ...others]) {
        if (Number.isFinite(v)) [low, high] = [Math.min(low, v), Math.max(high, v)];
      }
    }
    const [from, to] = this.range;
    if (low > high || (low >= from && high <= to && high - low > 0.4 * (to - from))) return;
    this.range = niceRange(low, high, least);
  }

  draw(source, view, colours) {
    const first = Math.max(0, source.since(view.from) - 1);
    this.fit(source, source.since(view.from));
    const axes = this.axes;
    if (!axes.begin([view.from, view.to], this.range, colours)) return;
    const { value, reference, half } = this.quantity;
    const time = (i) => source.time(i);
    const of = (name) => (i) => source.value(name, i);
    const end = source.since(view.to + 1e-6);
    const breaks = { gap: source.envelope ? 0 : GAP_S, torn: (i) => source.gap(i) };
    // The grid is at round clock times.
    const zero = source.clock_s + offset_s(view.to + source.clock_s);
    [axes.from, axes.to] = [view.from + zero, view.to + zero];
    const step = timeStep(view.to - view.from, axes.box.right - axes.box.left);
    axes.grid(step, this.last ? (t) => timeOfDay(t, step) : null);
    [axes.from, axes.to] = [view.from, view.to];
    this.phases(source, Math.min(source.since(view.from), end), end, colours);
    axes.clip();
    this.bounds(axes, colours);
    if (half || source.envelope) {
      axes.band(first, end, time, (i) => this.ends(source, i)[0], (i) => this.ends(source, i)[1],
        colours.band, breaks);
    }
    if (reference) {
      axes.line(first, end, time, of(reference), colours.reference, { dash: [6, 4], width: 1.4, ...breaks });
    }
    if (this.second) axes.line(first, end, time, of(this.second), colours.second, breaks);
    axes.line(first, end, time, of(value), colours.measured, breaks);
    if (view.picked) axes.shade(...view.picked, colours.band);
    if (view.cross !== null) axes.upright(view.cross, colours.ink);
    axes.unclip();
  }

  /** Zero, the tolerance of the job, and the limits; one far away is out of sight, and widens no chart. */
  bounds(axes, colours) {
    const { tolerance, quantity } = this;
    this.within.hidden = tolerance === null;
    if (tolerance !== null) {
      setText(this.within, `tolerance of the job, ± ${number(tolerance, quantity.decimals)}`);
      axes.zone(-tolerance, tolerance, colours.zone);
    }
    if (quantity.zero) axes.level(0, colours.text);
    for (const limit of this.limits) axes.level(limit, colours.limit, [8, 4]);
  }

  /** Colour each phase, or each job of many, with a line where the next begins; the first strip names them. */
  phases(source, first, end, colours) {
    const { axes } = this;
    const starts = [];
    for (let i = first + 1; i < end; i += 1) {
      if (source.part(i) !== source.part(i - 1)) starts.push(i);
    }
    for (const [place, from] of [first, ...starts].entries()) {
      const next = starts[place] ?? end;
      const to_s = source.envelope ? source.time(next - 1) + source.step_s : source.time(Math.min(next, end - 1));
      if (from < end && source.hue(from) !== undefined) axes.stretch(source.time(from), to_s, source.hue(from));
    }
    if (starts.length <= JOBS_MARKED) {
      for (const i of starts) axes.upright(source.time(i), colours.text, [2, 3]);
    }
    if (!this.first || first >= end) return;
    axes.names([first, ...starts].map((i) => [source.time(i), source.phase(i)]), source.time(end - 1));
  }

  /** The value at a point, of both arms where both are drawn; in hours the smallest and the largest. */
  words(source, index) {
    const { value, unit, decimals } = this.quantity;
    if (!source.envelope) {
      const values = this.second ? [value, this.second] : [value];
      return `${values.map((name) => number(source.value(name, index), decimals)).join(" and ")} ${unit}`;
    }
    const [low, high] = this.ends(source, index).map((each) => number(each, decimals));
    return low === high ? `${low} ${unit}` : `${low} to ${high} ${unit}`;
  }
}

/** The newest value of a quantity, with its reference or the tolerance of the job. */
export class Readout {
  constructor(quantity) {
    this.quantity = quantity;
    this.tolerance = null;
    this.value = h("span", { class: "figure" }, "–");
    this.more = h("span", { class: "more" });
    this.reference = h("td", { class: "ref", role: "cell" });
    this.name = h("th", { scope: "row", role: "rowheader" }, quantity.name);
    this.element = h("tr", { role: "row" }, this.name,
      h("td", { class: "now", role: "cell" }, this.value, " ",
        h("span", { class: "unit" }, quantity.unit), this.more), this.reference);
  }

  /** Name the arm where the rig has two. */
  settle({ both }) {
    const { name, second } = this.quantity;
    setText(this.name, both && second ? `${name}, arm 1` : name);
  }

  show(recent) {
    const { value, half, reference, decimals } = this.quantity;
    const latest = (name) => (name ? recent.latest(name) : NaN);
    setText(this.value, number(latest(value), decimals));
    const u = latest(half);
    setText(this.more, Number.isFinite(u) ? `± ${number(u, 2)}` : "");
    const wanted = latest(reference);
    let text = Number.isFinite(wanted) ? `ref ${number(wanted, decimals)}` : "\u00a0";
    if (this.tolerance !== null) text = `tolerance ± ${number(this.tolerance, decimals)}`;
    setText(this.reference, text);
  }
}
