// The kinds of job that the supervisor has, as it describes them: forms, figures, actions.

import { get } from "./api.js";
import { plain, unitOf, withUnit } from "./words.js";

let known = [];
let offered = new Map();

export async function loadKinds() {
  known = (await get("/kinds")).kinds;
  offered = new Map();
}

export const kinds = () => known;

const forArms = (arms) => (each) => each.arms.includes(arms);

/** The kinds of job that a rig with this number of arms takes, with the fields that it takes. */
export function kindsFor(arms) {
  if (!offered.has(arms)) {
    offered.set(arms, known.filter(forArms(arms))
      .map((kind) => ({ ...kind, form: kind.form.filter(forArms(arms)) })));
  }
  return offered.get(arms);
}

/** A kind by its name; of one that is not installed any more, what all kinds have. */
export const kindOf = (name) => known.find((each) => each.name === name)
  ?? { name, label: plain(name), form: [], figures: [], actions: [], variant_field: "", variants: [] };

/** A member of a result; a dot leads to a member of a member. */
const memberOf = (result, name) => name.split(".").reduce((part, each) => part?.[each], result);

const assumedBy = (result, figure) => (figure.assumed && memberOf(result, figure.assumed)) || [];

function shown(result, figure) {
  const value = memberOf(result, figure.name);
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return value === null || value === undefined ? "–" : plain(value);
  const spread = figure.uncertainty ? memberOf(result, figure.uncertainty) : null;
  const more = typeof spread === "number" ? ` ± ${withUnit(spread, "", figure.digits).trim()}` : "";
  const by = more && assumedBy(result, figure).length ? " (assumed)" : "";
  return `${withUnit(value, "", figure.digits).trim()}${more} ${figure.unit}${by}`.trim();
}

/** The figures that are shown of a job's result; only that of two arms states the number of arms. */
const figuresFor = ({ kind, result }) => kindOf(kind).figures.filter(forArms(result?.arms ?? 1));

/** Labels and texts of a job's figures, in their order. */
export function figuresOf(job) {
  const result = job.result ?? {};
  return figuresFor(job)
    .filter((each) => !["", null, undefined].includes(memberOf(result, each.name)))
    .map((each) => [each.label, shown(result, each)]);
}

/** Quantities that the uncertainty of a figure assumes, since no calibration has found them. */
export function assumedOf(job) {
  return [...new Set(figuresFor(job).flatMap((each) => assumedBy(job.result ?? {}, each)))];
}

/** The figure of a job that lists show: its label and its text. */
export function mainFigure(job) {
  const figure = figuresFor(job).find((each) => each.main);
  return figure && job.result ? [figure.label, shown(job.result, figure)] : ["", "–"];
}

/** A short text of the request of a job. */
export function asked({ kind: name, request }) {
  const kind = kindOf(name);
  const label = plain(name);
  if (kind.variant_field) return `${label} ${plain(request[kind.variant_field])}`;
  for (const field of kind.form) {
    if (field.names) {
      const chosen = field.choices.find((each) => typeof request[each.value] === "number");
      if (chosen) return `${label} ${chosen.label.split(" ")[0]} ${withUnit(request[chosen.value], unitOf(chosen.value))}`;
    } else if (typeof request[field.name] === "number" && field.name in request) {
      return `${label} ${withUnit(request[field.name], field.unit)}`;
    }
  }
  return request.recipe ? `${label} ${request.recipe}` : label;
}

/** Fields whose default values come from the plan of an empty request. */
export const plannedFields = (form) => form.filter((each) => each.planned);

/** What the phases of a plan say about values that a request left out. */
export function defaultsOf(plan, form) {
  const found = {};
  for (const { name, planned } of plannedFields(form)) {
    const [phase, member] = planned.split(".");
    const value = plan.phases?.find((each) => each.phase === phase)?.[member];
    if (typeof value === "number") found[name] = Number(value.toFixed(4));
  }
  return found;
}
