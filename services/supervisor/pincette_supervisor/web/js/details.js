// The rig in detail: its programs, its limits, and the model in use with its versions.

import { get, post, RIG_PATH, told } from "./api.js";
import { figure } from "./calibrations.js";
import { byId, chip, h, headOf, loading, show } from "./dom.js";
import { clock, number, plain, significant, withoutUnit } from "./words.js";

function table(caption, head, rows) {
  return h("table", { class: "list" }, h("caption", {}, caption), headOf(head), h("tbody", {}, ...rows));
}

const age = (seconds) => (seconds === null ? "–" : `${number(seconds, seconds < 1 ? 3 : 1)} s`);

const count = (value) => (value === null || value === undefined ? "–" : String(value));

function programs(rig) {
  const head = ["Program", "State", "Age", "Missed", "Late answers", "Lost answers"];
  return table("Programs", head, rig.programs.map((each) => h("tr", {},
    h("th", { scope: "row" }, each.name),
    h("td", {}, each.trouble ? chip(each.trouble, "bad") : chip(each.alive ? "alive" : "silent",
      each.alive ? "good" : "warn")),
    h("td", {}, age(each.age_s)), h("td", {}, count(each.missed)),
    h("td", {}, count(each.instrument?.late)), h("td", {}, count(each.instrument?.lost)))));
}

function limits(rig) {
  return table("Limits", ["Limit", "Value"], rig.limits.map((each) => h("tr", {},
    h("th", { scope: "row" }, plain(each.quantity)),
    h("td", {}, `${significant(each.value)} ${each.unit}`))));
}

function quantities(model) {
  return table("Model in use", ["Quantity", "Value", "From"], model.quantities.map((each) => h("tr", {},
    h("th", { scope: "row" }, withoutUnit(each.quantity.replace(/^model\./, "")), h("span", { class: "unit block" }, each.unit)),
    h("td", {}, figure(each.value), each.uncertainty === null ? ""
      : h("span", { class: "muted block" }, `± ${significant(each.uncertainty, 2)}`)),
    h("td", {}, each.source === "assumed" ? "assumed" : clock(each.accepted_at),
      each.due_at ? h("span", { class: each.overdue ? "cause block" : "muted block" },
        `${each.overdue ? "was due" : "due"} ${clock(each.due_at)}`) : null))));
}

export class Details {
  constructor({ refresh }) {
    this.refreshAll = refresh;
    this.model = null;
    this.said = h("p", { class: "fault", role: "alert", id: "model-said" });
    byId("panel-rig").append(h("div", { id: "rig-programs" }), this.said,
      h("div", { id: "rig-model" }, loading()));
  }

  get seen() {
    return !byId("panel-rig").hidden;
  }

  /** Update while the tab is visible; the model is requested only if its version has changed. */
  async follow(rig) {
    if (!this.seen) return;
    show(byId("rig-programs"), [rig.programs, rig.limits], () => [programs(rig), limits(rig)]);
    if (this.model?.version === rig.model.version && this.model?.digest === rig.model.digest) return;
    this.model = await get(`${RIG_PATH}/model`);
    show(byId("rig-model"), this.model, () => [
      this.model.trouble ? h("p", { class: "cause" }, this.model.trouble) : null,
      quantities(this.model), this.versions()]);
  }

  versions() {
    const { version: used, versions } = this.model;
    const rows = [{ version: 0, quantities: [], made_at: null, trouble: "" }, ...versions];
    return table("Versions", ["Version", "Values", ""], rows.toReversed().map((each) => h("tr", {},
      h("th", { scope: "row" }, each.version ? String(each.version) : "rig file"),
      h("td", {}, each.quantities.map((name) => withoutUnit(name.split(".").at(-1))).join(", ") || "–",
        each.made_at ? h("span", { class: "muted block" }, clock(each.made_at)) : null,
        each.trouble ? h("span", { class: "cause block" }, each.trouble) : null),
      h("td", { class: "figures" }, each.version === used ? chip("in use", "good")
        : h("button", { type: "button", class: "quiet", id: `use-${each.version}`,
          "data-needs": "admin",
          "aria-label": each.version ? `Use version ${each.version}` : "Use the rig file alone",
          onclick: () => this.use(each.version) }, "Use")))));
  }

  async use(version) {
    this.said.textContent = "";
    try {
      await post(`${RIG_PATH}/model/actions`, { type: "use", version });
    } catch (problem) {
      this.said.textContent = told(problem);
    }
    this.refreshAll();
  }
}
