// Everything that is looked at of the rig, each with its value and its limit.

import { byId, chip, h, show } from "./dom.js";
import { significant } from "./words.js";

const TONES = { ok: "good", needed: "bad", look: "warn" };

function figure(value, unit) {
  if (value === null) return "–";
  return typeof value === "number" ? `${significant(value, 3)} ${unit}`.trim() : value;
}

function row(check) {
  const tone = TONES[check.ok ? "ok" : check.needed ? "needed" : "look"];
  const sized = typeof check.value === "number";
  return h("tr", {},
    // It may break after its dot alone.
    h("th", { scope: "row" }, check.name.replaceAll(".", ".\u200b")),
    h("td", {}, chip(check.words, tone)),
    h("td", { class: "figures" }, sized ? figure(check.value, check.unit) : "–",
      sized && check.limit !== null
        ? h("span", { class: "muted block" }, `limit ${figure(check.limit, check.unit)}`) : null));
}

export class Checks {
  constructor() {
    this.panel = h("div", { id: "rig-checks" });
    byId("panel-rig").append(this.panel);
  }

  /** Update while the tab is visible. */
  follow(rig) {
    if (byId("panel-rig").hidden) return;
    // Ages differ with every answer: a text is announced again only if its meaning has changed.
    const said = rig.checks.map((check) => [check.name, check.ok, check.words]);
    show(this.panel, said, () => h("table", { class: "list" }, h("caption", {}, "Checks"),
      h("thead", {}, h("tr", {}, ...["Check", "Finding", "Value"].map((text) => h("th",
        { scope: "col" }, text)))),
      h("tbody", {}, ...rig.checks.map(row))));
  }
}
