// The calibrations in the order to make them: what each needs and has found, and what is next.

import { checklistOfRig, post, told } from "./api.js";
import { byId, chip, h, headOf, loading, show } from "./dom.js";
import { clock, plain, significant, withoutUnit } from "./words.js";

const TONES = { done: "good", next: "busy", later: "muted", optional: "muted", unsupported: "muted" };

function gained({ quantity, value, unit, uncertainty }) {
  const name = withoutUnit(quantity.split(".").at(-1)).replaceAll("_", " ");
  if (typeof value !== "number") return `${name} measured`;
  const about = uncertainty === null ? "" : ` ± ${significant(uncertainty, 2)}`;
  return `${name} ${significant(value)}${about} ${unit}`;
}

export class Checklist {
  constructor({ refresh, accept }) {
    this.refreshAll = refresh;
    this.accept = accept;
    this.steps = [];
    this.said = h("p", { class: "fault", role: "alert", id: "checklist-said" });
    byId("panel-calibrations").append(this.said, h("div", { id: "checklist" }, loading()));
  }

  async refresh() {
    this.steps = (await checklistOfRig()).steps;
    show(byId("checklist"), this.steps, () => this.table());
  }

  table() {
    return h("table", { class: "list stacked" },
      h("caption", {}, "Calibrations in the order to run them"),
      headOf(["Calibration", "State", "Found, or needed"]),
      h("tbody", {}, ...this.steps.map((step, place) => this.row(step, place + 1))));
  }

  row(step, place) {
    return h("tr", { id: `step-${step.calibration}` },
      h("th", { scope: "row" }, `${place}. ${step.label}`),
      h("td", {}, chip(step.state, TONES[step.state]),
        step.accepted_at ? h("span", { class: "muted block" }, clock(step.accepted_at)) : null),
      h("td", { class: "below" }, ...this.content(step), this.button(step)));
  }

  content(step) {
    const found = step.gained.map((value) => h("div", {}, gained(value)));
    if (step.state === "done") return found;
    const why = step.reasons.filter(({ code }) => code !== "not_calibrated")
      .map(({ text }) => h("div", { class: "muted" }, text));
    if (step.state === "unsupported") return why;
    return [...found, ...step.needs.map(({ text }) => h("div", {}, text)), ...why];
  }

  button(step) {
    if (step.state === "done" || step.state === "unsupported") return null;
    if (step.proposal) {
      return h("div", { class: "buttons" }, h("button", { type: "button", class: "main",
        id: `step-accept-${step.calibration}`, "data-needs": "admin",
        "aria-label": `Accept ${plain(step.calibration)}`,
        onclick: () => this.accept(step.proposal) }, "Accept"));
    }
    return h("div", { class: "buttons" }, h("button", { type: "button",
      class: step.state === "next" ? "main" : "", id: `step-start-${step.calibration}`,
      "data-needs": "operate", "aria-label": `Start ${plain(step.calibration)}`,
      onclick: () => this.start(step) }, "Start"));
  }

  async start(step) {
    this.said.textContent = "";
    try {
      await post("/jobs", step.request);
    } catch (problem) {
      this.said.textContent = told(problem);
    }
    this.refreshAll();
  }
}
