// What calibrations propose, beside what is in use; nothing changes until a person accepts it.

import { calibrationsOfRig, post, told } from "./api.js";
import { Checklist } from "./checklist.js";
import { byId, chip, h, headOf, left, loading, show } from "./dom.js";
import { clock, plain, significant, withoutUnit } from "./words.js";

const MOST = 50;
const TONES = { proposed: "busy", accepted: "good", discarded: "muted", superseded: "muted" };
const DECIDED = { accept: "Accept", discard: "Discard" };

/** An address of the supervisor, relative to that of the page. */
const relative = (address) => address.replace(/^\//, "");

export function figure(value) {
  if (typeof value === "number") return significant(value);
  if (Array.isArray(value)) return `${value.length} numbers`;
  if (value && typeof value === "object") return "a table";
  return value === null || value === undefined ? "–" : String(value);
}

function difference({ difference: by, difference_percent: percent, in_use: before, value }) {
  if (by === null) return JSON.stringify(before) === JSON.stringify(value) ? "none" : "another";
  const sign = by > 0 ? "+" : "";
  return sign + significant(by, 3) + (percent === null ? "" : ` (${sign}${significant(percent, 2)} %)`);
}

export class Calibrations {
  constructor({ refresh }) {
    this.refreshAll = refresh;
    this.proposals = [];
    this.said = h("p", { class: "fault", role: "alert", id: "calibration-said" });
    this.done = h("p", { class: "hint", role: "status", id: "calibration-done" });
    this.checklist = new Checklist({ refresh, accept: (id) => this.act({ id }, "accept") });
    byId("panel-calibrations").append(this.said, this.done, h("div", { id: "proposals" }, loading()));
  }

  async refresh() {
    await this.checklist.refresh();
    const { calibrations, next } = await calibrationsOfRig(`limit=${MOST}`);
    this.proposals = calibrations;
    show(byId("proposals"), [calibrations, next], () => this.list(next));
  }

  list(next) {
    if (!this.proposals.length) {
      return h("p", { class: "muted" },
        "No calibration has proposed anything yet. Proposals are listed here.");
    }
    return [...this.proposals.map((each) => this.proposal(each)),
      next === null ? null : left(`The newest ${MOST} are shown; pincette model show --proposals lists all.`)];
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
      h("a", { href: relative(each.plot), target: "_blank", rel: "noopener" },
        h("img", { src: relative(each.plot), class: "picture", loading: "lazy",
          alt: `${plain(each.calibration)}: what was measured, and what the fit leaves` })),
      this.basis(each),
      each.model_version ? h("p", { class: "muted" }, `Accepted as version ${each.model_version} of the model.`)
        : null,
      each.allowed_actions.length ? h("div", { class: "buttons" },
        ...each.allowed_actions.map((type) => h("button", { type: "button",
          id: `${type}-${each.id}`, class: type === "accept" ? "main" : "", "data-needs": "admin",
          "aria-label": `${DECIDED[type]} ${plain(each.calibration)} of ${clock(each.made_at)}`,
          onclick: () => this.act(each, type) }, DECIDED[type]))) : null);
  }

  values(each) {
    const decided = each.state !== "proposed";
    const head = ["Quantity", decided ? "In use before" : "In use", "Proposed", "Difference"];
    return h("table", { class: "list" },
      h("caption", { class: "unseen" }, `Proposal of ${plain(each.calibration)}`),
      headOf(head),
      h("tbody", {}, ...each.values.map((value) => {
        const about = value.uncertainty === null ? "" : ` ± ${significant(value.uncertainty, 2)}`;
        return h("tr", {},
          h("th", { scope: "row" }, withoutUnit(value.quantity.split(".").at(-1)),
            h("span", { class: "unit block" }, value.unit)),
          h("td", {}, figure(value.in_use),
            value.source_in_use === "assumed" ? h("span", { class: "muted block" }, "assumed") : null),
          h("td", {}, figure(value.value) + about),
          h("td", {}, difference(value)));
      })));
  }

  residuals(each) {
    const left = each.residuals;
    const facts = left ? [
      [`Residual of ${left.of}, r.m.s.`, `${significant(left.rms, 3)} ${left.unit}`],
      ["at most", `${significant(left.maximum, 3)} ${left.unit}`],
      ["over", `${left.count} points`]] : [];
    for (const { meaning, value, unit } of each.figures) {
      facts.push([meaning, `${significant(value, 3)} ${unit}`]);
    }
    if (!facts.length) return null;
    return h("dl", { class: "figures-list" },
      ...facts.map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", {}, text))));
  }

  basis(each) {
    if (!each.assumptions.length) return null;
    return h("details", { class: "notes", id: `basis-${each.id}` }, h("summary", {}, "Basis of the values"),
      h("ul", { class: "dots" }, ...each.assumptions.map(({ quantity, value, unit, source }) => h("li", {},
        `${quantity} = ${figure(value)} ${unit} (${source})`))));
  }

  async act(each, type) {
    this.said.textContent = "";
    this.done.textContent = "";
    try {
      const { model_version: version } = await post(`/calibrations/${each.id}/actions`, { type });
      this.done.textContent = type === "accept" ? `Accepted: version ${version} of the model is in use.`
        : "Discarded: the model in use is unchanged.";
    } catch (problem) {
      this.said.textContent = told(problem);
    }
    await this.refresh().catch(() => {});
    this.refreshAll();
  }
}
