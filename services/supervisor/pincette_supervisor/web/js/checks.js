// Everything that is looked at of the rig, each with its value and its limit.

import { byId, chip, h, headOf, show } from "./dom.js";
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
    h("th", { scope: "row" }, check.name),
    h("td", { class: "below" }, chip(check.words, tone)),
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
    show(this.panel, said, () => h("table", { class: "list stacked" }, h("caption", {}, "Checks"),
      headOf(["Check", "Finding", "Value"]),
      h("tbody", {}, ...rig.checks.map(row))));
  }
}
