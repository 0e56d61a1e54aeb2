// The curves that a plan predicts, with the limits near them and the places where one is broken.

import { Axes, niceRange, niceStep, palette } from "./axes.js";
import { h } from "../dom.js";
import { number } from "../words.js";

const CURVES = [
  { name: "Position", unit: "µm", value: "x_um", reference: "x_r_um", least: 1,
    limits: ["position_min", "position_max"], quantity: "position" },
  { name: "Contact force", unit: "mN", value: "force_mN", reference: "force_r_mN", least: 1,
    limits: ["force_max"], quantity: "force" },
  { name: "Place", unit: "µm", value: "place_um", reference: "place_r_um", least: 1, limits: [],
    quantity: "place" },
  { name: "Contact force, arm 2", unit: "mN", value: "second_force_mN", reference: "force_r_mN", least: 1,
    limits: ["force_max"], quantity: "force", arms: 2 },
  { name: "Voltage", unit: "V", value: "voltage_V", least: 0.1,
    limits: ["voltage_min", "voltage_max"], quantity: "voltage" },
  { name: "Voltage, arm 2", unit: "V", value: "second_voltage_V", least: 0.1,
    limits: ["voltage_min", "voltage_max"], quantity: "voltage", arms: 2 },
  { name: "Sliding function", unit: "µm", value: "sliding_um", least: 0.1, limits: [],
    quantity: "sliding", arms: 1 },
];

/** Figures of the curves of a plan, drawn once they have a size. */
export function drawPrediction(plan, limits) {
  const found = plan.prediction?.curves ?? plan.curves;
  if (!found?.t_s || found.t_s.length < 2) return [];
  const colours = palette();
  const phases = plan.prediction?.phases ?? plan.phases ?? [];
  const arms = found.second_voltage_V ? 2 : 1;
  return CURVES.filter(({ value, reference, arms: of = arms }) => of === arms
    && (found[value] || found[reference])).map((curve, place) => {
    const columns = [curve.value, curve.reference].map((name) => found[name] ?? null);
    const all = columns.flatMap((column) => column ?? []).filter(Number.isFinite);
    const [low, high] = [Math.min(...all), Math.max(...all)];
    const canvas = h("canvas", { class: place === 0 ? "curve names" : "curve", "aria-hidden": "true" });
    requestAnimationFrame(() => draw(canvas, {
      t_s: found.t_s, columns, range: niceRange(low, high, curve.least), colours, phases,
      names: place === 0,
      limits: limits.filter((each) => curve.limits.includes(each.quantity)).map((each) => each.value),
      broken: (plan.violations ?? []).filter((each) => each.quantity === curve.quantity),
    }));
    return h("figure", { class: "predicted" }, h("figcaption", {},
      h("b", {}, curve.name), h("span", { class: "unit" }, curve.unit),
      h("span", { class: "muted" }, `${number(low, 2)} to ${number(high, 2)}`),
      place === 0 ? h("span", { class: "keys" }, h("span", { class: "key measured" }, "predicted"),
        h("span", { class: "key reference" }, "reference")) : null), canvas);
  });
}

function draw(canvas, { t_s, columns: [value, reference], range, colours, phases, names, limits, broken }) {
  const axes = new Axes(canvas, { top: names ? 20 : 8, bottom: 24 });
  const end = t_s.at(-1);
  if (!axes.begin([t_s[0], end], range, colours)) return;
  const step = niceStep(end - t_s[0], 5);
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  axes.grid(step, (t) => `${number(t, decimals)} s`);
  const starts = phases.map((phase) => [phase.start_s, phase.phase]).filter(([at]) => at < end);
  for (const [at] of starts.slice(1)) axes.upright(at, colours.text, [2, 3]);
  if (names) axes.names(starts, end);
  axes.clip();
  for (const limit of limits) axes.level(limit, colours.limit, [8, 4]);
  const time = (i) => t_s[i];
  if (reference) {
    axes.line(0, t_s.length, time, (i) => reference[i], colours.reference, { dash: [6, 4] });
  }
  if (value) axes.line(0, t_s.length, time, (i) => value[i], colours.measured);
  for (const each of broken) axes.upright(Math.min(each.at_s, end), colours.limit);
  axes.unclip();
}
