// What a dry run foretells: how long, along which curves, and every limit that would be broken.

import { Axes, niceRange, niceStep, palette } from "./axes.js";
import { h } from "./dom.js";
import { duration, number, plain, significant } from "./words.js";

const CURVES = [
  { name: "Position", unit: "µm", value: "x_um", reference: "x_r_um", least: 1 },
  { name: "Force", unit: "mN", value: "force_mN", reference: "force_r_mN", least: 1 },
  { name: "Voltage", unit: "V", value: "voltage_V", least: 0.1 },
];

/** Show a plan in its place. */
export function showPlan(place, plan) {
  const seconds = plan.duration_s;
  const waits = plan.waits ? `, and waits ${plan.waits} times for a person` : "";
  const verdict = plan.feasible ? `Feasible: takes ${duration(seconds)}${waits}`
    : "Not feasible: it would not be started";
  const outcome = plan.prediction?.outcome ? `; foretold outcome: ${plain(plan.prediction.outcome)}`
    : "";
  place.replaceChildren(
    h("p", { class: "verdict", "data-tone": plan.feasible ? "good" : "bad" }, verdict + outcome),
    ...violations(plan), plan.prediction?.cut ? h("p", { class: "muted" }, plan.prediction.cut) : "",
    ...curves(plan), margins(plan) ?? "");
}

function violations(plan) {
  if (!plan.violations?.length) return [];
  return [h("ul", { class: "violations" }, ...plan.violations.map((each) => h("li", {},
    each.message, h("span", { class: "muted" }, ` at ${number(each.at_s, 2)} s`))))];
}

function margins(plan) {
  const found = plan.prediction?.margins;
  if (!found?.length) return null;
  const rows = found.map((each) => h("tr", {},
    h("th", { scope: "row" }, plain(each.quantity)),
    h("td", {}, `${significant(each.distance, 3)} ${each.unit}`),
    h("td", {}, plain(each.phase))));
  return h("details", { id: "plan-margins" }, h("summary", {}, "Distances to the limits"),
    h("table", { class: "list" }, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Limit"),
      h("th", { scope: "col" }, "Distance"), h("th", { scope: "col" }, "Phase"))),
    h("tbody", {}, ...rows)));
}

function curves(plan) {
  const planned = plan.curves;
  const found = plan.prediction?.curves ?? planned;
  if (!found?.t_s || found.t_s.length < 2) return [];
  const colours = palette();
  return CURVES.filter(({ value, reference }) => found[value] || found[reference]).map((each) => {
    const canvas = h("canvas", { class: "curve", "aria-hidden": "true" });
    const columns = [each.value, each.reference].map((name) => found[name] ?? null);
    const all = columns.flatMap((column) => column ?? []).filter(Number.isFinite);
    const [low, high] = [Math.min(...all), Math.max(...all)];
    requestAnimationFrame(() => draw(canvas, found.t_s, columns, niceRange(low, high, each.least),
      colours));
    return h("figure", { class: "foretold" }, h("figcaption", {},
      h("b", {}, each.name), h("span", { class: "unit" }, each.unit),
      h("span", { class: "muted" }, `${number(low, 2)} to ${number(high, 2)}`)), canvas);
  });
}

function draw(canvas, t_s, [value, reference], range, colours) {
  const axes = new Axes(canvas, { bottom: 24 });
  const end = t_s.at(-1);
  if (!axes.begin([t_s[0], end], range, colours)) return;
  const step = niceStep(end - t_s[0], 5);
  const decimals = Math.max(0, -Math.floor(Math.log10(step)));
  axes.grid(step, (t) => `${number(t, decimals)} s`);
  const time = (i) => t_s[i];
  if (reference) {
    axes.line(0, t_s.length, time, (i) => reference[i], colours.reference, { dash: [6, 4] });
  }
  if (value) axes.line(0, t_s.length, time, (i) => value[i], colours.measured);
}
