// Jobs in one chart, each over its own time.

import { get, RIG_PATH } from "../api.js";
import { byId, h, loading, setText } from "../dom.js";
import { mainFigure } from "../kinds.js";
import { clock, number, plain } from "../words.js";
import { Axes, niceRange, niceStep, palette } from "./axes.js";
import { onDrag } from "./drag.js";

export const MOST = 6;
const POINTS = 1500;
const MARK_PX = 64;
const CHARTS = [
  { name: "Position", unit: "µm", value: "x_um", second: "second_x_um", least: 1, decimals: 2 },
  { name: "Contact force", unit: "mN", value: "force_mN", second: "second_force_mN", least: 1, decimals: 2 },
  { name: "Voltage", unit: "V", value: "voltage_V", second: "second_voltage_V", least: 0.2, decimals: 3 },
];
/** Colour and dashes of each job, so that colour is never the only sign; as in page.css. */
const LINES = [["measured", []], ["reference", [7, 3]], ["second", [2, 2]], ["good", [9, 3, 2, 3]],
  ["limit", [4, 4]], ["ink", [12, 4]]];
/** Width of the lines of arm 1 and of arm 2, in px. */
const WIDTHS = [1.6, 3.2];

/** The record of one job over its own time, at its place among those that are compared. */
class Course {
  constructor(job, found) {
    this.job = job;
    this.found = found;
    this.t_s = found.at_s.map((at) => at - found.from_s);
  }

  /** Whether the record has a quantity. */
  has(name) {
    return name in this.found.low;
  }

  value(name, i) {
    const [low, high] = [this.found.low[name]?.[i] ?? NaN, this.found.high[name]?.[i] ?? NaN];
    return (low + high) / 2;
  }

  /** The value at a time; NaN before and after the job. */
  at(name, t_s) {
    const i = this.t_s.findIndex((each) => each >= t_s);
    return i < 0 || t_s < 0 ? NaN : this.value(name, i);
  }
}

/** The charts of the jobs that a person compares, in the place of the live ones. */
export class Comparison {
  constructor() {
    this.courses = [];
    this.zoom = null;
    this.cross = null;
    this.picked = null;
    this.element = byId("comparison");
    this.charts = CHARTS.map((quantity) => {
      const canvas = h("canvas", { "aria-hidden": "true" });
      const said = h("output", { class: "strip-said" });
      const arms = h("span", { class: "unit", hidden: true }, "thin: arm 1, thick: arm 2");
      return { quantity, canvas, said, arms, axes: new Axes(canvas, { bottom: 24 }),
        element: h("figure", { class: "strip", "data-compared": quantity.value },
          h("figcaption", {}, h("b", {}, quantity.name), h("span", { class: "unit" }, quantity.unit), arms, said), canvas) };
    });
    this.whole = h("button", { type: "button", class: "quiet", id: "comparison-whole", hidden: true,
      onclick: () => this.zoomTo(null) }, "Zoom out");
    this.list = h("ol", { class: "compared" });
    this.title = h("h2", { id: "comparison-title", tabindex: "-1" });
    this.element.append(h("div", { class: "scope-head" }, this.title, this.whole,
      h("button", { type: "button", id: "comparison-close", onclick: () => this.close() }, "Back to live charts")),
    this.list, ...this.charts.map(({ element }) => element));
    onDrag(this.element, (canvas) => this.charts.find((each) => each.canvas === canvas)?.axes, {
      chosen: (range) => this.zoomTo(range), picking: (picked) => {
        this.picked = picked;
        this.draw();
      } });
    this.element.addEventListener("dblclick", () => this.zoomTo(null));
    this.element.addEventListener("pointermove", (event) => this.point(event));
    this.element.addEventListener("pointerdown", (event) => this.point(event));
    new ResizeObserver(() => this.draw()).observe(this.element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  /** Show one job that has ended, or compare several. */
  async show(jobs) {
    const asked = this.asked = Symbol("request");
    this.courses = [];
    this.list.replaceChildren(h("li", {}, loading()));
    this.title.textContent = jobs.length > 1 ? `${jobs.length} jobs compared` : "One job";
    this.open(true);
    this.title.focus({ preventScroll: true });
    this.element.scrollIntoView({ block: "start" });
    try {
      const found = await Promise.all(jobs.map((job) =>
        get(`${RIG_PATH}/history?job=${encodeURIComponent(job.id)}&points=${POINTS}`)));
      if (asked !== this.asked) return;
      this.courses = jobs.map((job, place) => new Course(job, found[place]));
      this.list.replaceChildren(...this.courses.map((each, place) => this.entry(each, place)));
    } catch (problem) {
      if (asked === this.asked) this.list.replaceChildren(h("li", { class: "fault" }, problem.message));
    }
    this.zoomTo(null);
  }

  open(open) {
    this.element.hidden = !open;
    this.element.parentElement.classList.toggle("compared-only", open);
  }

  close() {
    this.asked = null;
    this.open(false);
  }

  entry({ job, found }, place) {
    const [label, figure] = mainFigure(job);
    const text = [clock(job.started_at ?? job.created_at), plain(job.kind), job.sample, label && `${label} ${figure}`,
      found.at_s.length ? "" : "no record"];
    return h("li", { class: `key key-${place}` }, text.filter(Boolean).join(" · "));
  }

  zoomTo(range) {
    this.zoom = range;
    this.whole.hidden = !range;
    this.draw();
  }

  point(event) {
    const chart = this.charts.find(({ canvas }) => canvas === event.target);
    if (!chart?.axes.box) return;
    this.cross = chart.axes.timeAt(event.clientX - chart.canvas.getBoundingClientRect().left);
    this.draw();
  }

  draw() {
    if (this.element.hidden || !this.courses.length) return;
    const colours = palette();
    const end_s = Math.max(1e-3, ...this.courses.map(({ t_s }) => t_s.at(-1) ?? 0));
    const [from, to] = this.zoom ?? [0, end_s];
    for (const chart of this.charts) this.drawOne(chart, [from, to], colours);
  }

  drawOne({ quantity, axes, said, arms }, [from, to], colours) {
    const { value, second, unit, least, decimals } = quantity;
    const within = ({ t_s }, i) => t_s[i] >= from && t_s[i] <= to;
    const lines = this.courses.flatMap((course, place) => [value, second].map((name, arm) => ({ course, place, name, arm }))
      .filter(({ name }) => course.has(name)));
    arms.hidden = !lines.some(({ arm }) => arm);
    const values = lines.flatMap(({ course, name }) =>
      course.t_s.map((_, i) => (within(course, i) ? course.value(name, i) : NaN))).filter(Number.isFinite);
    const low = values.reduce((a, b) => Math.min(a, b), Infinity);
    const high = values.reduce((a, b) => Math.max(a, b), -Infinity);
    if (!axes.begin([from, to], niceRange(low, high, least), colours)) return;
    const step = niceStep(to - from, Math.max(2, Math.min(8, (axes.box.right - axes.box.left) / MARK_PX)));
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    axes.grid(step, (t) => `${number(t, digits)} s`);
    axes.clip();
    for (const { course, place, name, arm } of lines) {
      const [colour, dash] = LINES[place];
      axes.line(0, course.t_s.length, (i) => course.t_s[i], (i) => course.value(name, i), colours[colour],
        { dash, width: WIDTHS[arm] });
    }
    if (this.picked) axes.shade(...this.picked, colours.band);
    if (this.cross !== null) axes.upright(this.cross, colours.ink);
    axes.unclip();
    setText(said, this.cross === null ? "" : `${this.courses.map((course) => lines
      .filter((line) => line.course === course).map(({ name }) => number(course.at(name, this.cross), decimals))
      .join(" / ")).join(", ")} ${unit} at ${number(this.cross, 2)} s`);
  }
}
