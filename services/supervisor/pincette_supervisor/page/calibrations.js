// What calibrations propose, beside what is in use; nothing changes until a person accepts it.

import { get, post } from "./api.js";
import { byId, chip, h, show } from "./dom.js";
import { clock, plain, significant, withoutUnit } from "./words.js";

const TONES = { proposed: "busy", accepted: "good", discarded: "muted", superseded: "muted" };

function figure(value) {
  if (typeof value === "number") return significant(value);
  if (Array.isArray(value)) return `${value.length} numbers`;
  if (value && typeof value === "object") return "a table";
  return value === null || value === undefined ? "–" : String(value);
}

export class Calibrations {
  constructor({ refresh }) {
    this.refreshAll = refresh;
    this.proposals = [];
    this.said = h("p", { class: "fault", role: "alert", id: "calibration-said" });
    byId("panel-calibrations").append(this.said, h("div", { id: "proposals" }));
  }

  async refresh() {
    const { calibrations } = await get("/calibrations?limit=20");
    this.proposals = calibrations;
    show(byId("proposals"), calibrations, () => this.list());
  }

  list() {
    if (!this.proposals.length) {
      return h("p", { class: "muted" },
        "No calibration has proposed anything yet. Start one under Start; what it finds waits here.");
    }
    return this.proposals.map((each) => this.proposal(each));
  }

  proposal(each) {
    const open = each.state === "proposed";
    return h("details", { id: `proposal-${each.id}`, class: "proposal", open },
      h("summary", {}, h("b", {}, plain(each.calibration)), chip(each.state, TONES[each.state]),
        h("span", { class: "muted" }, clock(each.made_at))),
      each.statement ? h("p", {}, each.statement) : null,
      each.warnings.length ? h("ul", { class: "violations" },
        ...each.warnings.map((text) => h("li", {}, text))) : null,
      this.values(each), this.residuals(each),
      h("p", {}, h("a", { href: each.plot, target: "_blank", rel: "noopener" }, "Plot"),
        each.model_version ? ` · accepted as version ${each.model_version}` : ""),
      each.allowed_actions.length ? h("div", { class: "buttons" },
        ...each.allowed_actions.map((type) => h("button", { type: "button",
          id: `${type}-${each.id}`, class: type === "accept" ? "main" : "quiet",
          onclick: () => this.act(each, type) }, type === "accept" ? "Accept" : "Discard"))) : null);
  }

  values(each) {
    const head = ["Quantity", "In use", "Proposed", "Difference"];
    return h("table", { class: "list" },
      h("caption", { class: "unseen" }, `What ${plain(each.calibration)} proposes`),
      h("thead", {}, h("tr", {}, ...head.map((text) => h("th", { scope: "col" }, text)))),
      h("tbody", {}, ...each.values.map((value) => {
        const about = value.uncertainty === null ? "" : ` ± ${significant(value.uncertainty, 2)}`;
        const percent = value.difference_percent;
        return h("tr", {},
          h("th", { scope: "row" }, withoutUnit(value.quantity.split(".").at(-1)),
            h("span", { class: "unit block" }, value.unit)),
          h("td", {}, figure(value.in_use),
            value.source_in_use === "assumed" ? h("span", { class: "muted block" }, "assumed") : null),
          h("td", {}, figure(value.value) + about),
          h("td", {}, percent === null ? "–" : `${significant(percent, 3)} %`));
      })));
  }

  residuals(each) {
    const left = each.residuals;
    if (!left) return null;
    return h("p", { class: "muted" }, `The fit leaves ${significant(left.rms, 3)} ${left.unit} r.m.s., `
      + `${significant(left.maximum, 3)} ${left.unit} at most, of ${left.of}, over ${left.count} points.`);
  }

  async act(each, type) {
    this.said.textContent = "";
    try {
      await post(`/calibrations/${each.id}/actions`, { type });
    } catch (problem) {
      this.said.textContent = `${problem.title}: ${problem.message}`;
    }
    await this.refresh();
    this.refreshAll();
  }
}
