// What a dry run predicts: how long, along which curves, how near to the limits, and every limit
// that would be broken.

import { drawPrediction } from "../plots/prediction.js";
import { h, headOf } from "../dom.js";
import { duration, number, plain, significant } from "../words.js";

function verdict(plan) {
  const waits = plan.waits ? `, and waits ${plan.waits} times for a person` : "";
  const outcome = plan.prediction?.outcome ? `; predicted outcome: ${plain(plan.prediction.outcome)}`
    : "";
  return (plan.feasible ? `Feasible: takes ${duration(plan.duration_s)}${waits}`
    : "Not feasible: it would not be started") + outcome;
}

function values(sent) {
  if (!sent.length) return [h("p", { class: "muted", id: "plan-sent" }, "All values are those of the rig file.")];
  return [h("dl", { class: "figures-list", id: "plan-sent" }, ...sent.map(([name, text]) => h("div", {},
    h("dt", {}, name), h("dd", {}, text))))];
}

function violations(plan) {
  if (!plan.violations?.length) return [];
  return [h("ul", { class: "violations" }, ...plan.violations.map((each) => h("li", {},
    each.message, h("span", { class: "muted" }, ` at ${number(each.at_s, 2)} s`))))];
}

function notes(texts, title) {
  if (!texts?.length) return [];
  return [h("details", { class: "notes" }, h("summary", {}, title),
    h("ul", { class: "dots" }, ...texts.map((text) => h("li", {}, text))))];
}

function table(caption, head, rows) {
  return h("table", { class: "list" }, h("caption", {}, caption),
    headOf(head),
    h("tbody", {}, ...rows));
}

function margins(plan) {
  const found = plan.prediction?.margins;
  if (!found?.length) return [];
  const arms = found.some((each) => each.arm > 1);
  return [table("Distance to the limits", ["Limit", "Left", "Where"],
    found.map((each) => h("tr", { class: each.distance < 0 ? "broken" : "" },
      h("th", { scope: "row" }, `${arms ? `arm ${each.arm}, ` : ""}${plain(each.quantity)} ${
        significant(each.limit, 3)}`,
        h("span", { class: "unit" }, each.unit)),
      h("td", {}, `${significant(each.distance, 3)} ${each.unit}`),
      h("td", { class: "muted" }, `${plain(each.phase)}, ${number(each.at_s, 2)} s`))))];
}

/** Of two arms: what the job would come to, with what the estimators state of it. */
function figures(plan) {
  const found = plan.prediction?.figures;
  if (!found || found.force_held_mN === null) return [];
  const rows = [["force of both arms", `${number(found.force_held_mN, 2)} ± ${
    number(found.force_uncertainty_mN, 2)} mN`], ["place", `${number(found.held_place_um, 2)} µm`]];
  if (found.place_um) rows.push(["RMSE of the place", `${number(found.place_um.rmse, 3)} µm`]);
  if (found.force_mN) rows.push(["RMSE of the force", `${number(found.force_mN.rmse, 3)} mN`]);
  rows.push(["difference of both forces", `0 ± ${number(found.difference_uncertainty_mN, 2)} mN`]);
  return [table("Predicted result, without noise", ["", ""], rows.map(([name, value]) =>
    h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, value))))];
}

/** The law of a job, and what it errs where the part is not as expected. */
function law(plan) {
  const { law: chosen, steady_errors: errors } = plan;
  if (!chosen) return [];
  const texts = [`${chosen.scheme.toUpperCase()}, gains of ${chosen.gains_from}: spectral radius `
    + `${number(chosen.spectral_radius, 4)} at worst, limit ${number(chosen.spectral_radius_limit, 4)}`];
  if (chosen.sensitivity_peak !== null && chosen.sensitivity_peak_limit !== null) {
    texts.push(`peak of sensitivity ${number(chosen.sensitivity_peak, 2)} at worst, `
      + `limit ${chosen.sensitivity_peak_limit}`);
  }
  if (errors) {
    texts.push(`steady errors within the part's tolerances: position ${number(errors.position_min_um)} to `
      + `${number(errors.position_max_um)} µm, force ${number(errors.force_min_mN)} to `
      + `${number(errors.force_max_mN)} mN`);
  }
  return notes(texts, "Law and steady errors");
}

/** The place that a vision client or the request gave, and where the part is searched for. */
function place({ place: given }) {
  if (!given) return [];
  const ways = given.search_from_um.map(
    (from, arm) => `${number(from)} to ${number(given.search_to_um[arm])} µm`);
  return [h("p", { class: "muted" }, `Place of ${given.source}: ${number(given.x_um)} ± `
    + `${number(given.u_um)} µm; search range ${ways.join(" and ")}`)];
}

export class PlanView {
  constructor() {
    this.verdict = h("p", { class: "verdict", role: "status" });
    this.body = h("div", { class: "plan-body" });
    this.element = h("div", { id: "plan", class: "plan" }, this.verdict, this.body);
    this.clear();
  }

  say(text, tone) {
    this.verdict.textContent = text;
    this.verdict.dataset.tone = tone;
    this.element.hidden = text === "";
  }

  clear() {
    this.say("", "muted");
    this.body.replaceChildren();
  }

  /** Scroll it into view after a person has requested it. */
  reveal() {
    this.element.scrollIntoView({ block: "start" });
  }

  wait() {
    this.body.replaceChildren();
    this.say("planning …", "muted");
  }

  /** Show a plan; `sent` has label and text of each value that was sent for it. */
  show(plan, limits, sent) {
    this.say(verdict(plan), plan.feasible ? "good" : "bad");
    this.body.replaceChildren(...values(sent), ...violations(plan),
      ...(plan.warnings ?? []).map((text) => h("p", { class: "cause warn" }, text)),
      plan.prediction?.cut ? h("p", { class: "muted" }, plan.prediction.cut) : "",
      ...place(plan), ...drawPrediction(plan, limits), ...figures(plan), ...margins(plan),
      ...law(plan),
      ...notes(plan.prediction?.assumptions, "Assumptions"));
  }
}
