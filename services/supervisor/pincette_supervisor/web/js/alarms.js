// Alarms of the rig: those that are open, to be acknowledged, and on demand those of before.

import { get, post, RIG, told } from "./api.js";
import { byId, chip, h, headOf, left, loading, show } from "./dom.js";
import { clock } from "./words.js";

const OF_RIG = `rig=${encodeURIComponent(RIG)}`;
const MOST = 50;
const ENDS = { reset: "until the rig is reset", condition: "still present", acknowledge: "" };
/** Causes of a latch for which no alarm is raised: none, and the start of the actuator. */
const WITHOUT_ALARM = new Set(["", "boot"]);

export class Alarms {
  constructor({ refresh }) {
    this.refreshAll = refresh;
    this.all = false;
    this.alarms = [];
    this.said = byId("alarm-said");
    this.panel = h("section", { id: "alarms", "aria-labelledby": "alarms-title" });
    this.panel.append(loading());
    byId("panel-rig").prepend(this.panel);
  }

  /** The mark at the tab counts unacknowledged alarms, whichever tab is open. */
  async refresh() {
    const query = this.all ? "" : "&open=true";
    const { alarms, open, next } = await get(`/alarms?${OF_RIG}&limit=${MOST}${query}`);
    this.alarms = alarms;
    this.mark(open);
    this.head();
    this.render(open, next);
  }

  /** Return the alarm of the trip that latches the rig, or null where none is known. */
  tripOf({ cause }) {
    return this.alarms.find((each) => each.clears === "reset" && each.cleared_at === null
      && each.cause === cause) ?? null;
  }

  /** Whether the latch's trip has, or soon will have, an alarm; a latch from the start has none. */
  expectsTrip({ cause }) {
    return !WITHOUT_ALARM.has(cause);
  }

  mark(open) {
    const tab = byId("tab-rig");
    const text = open ? `Rig (${open} ${open === 1 ? "alarm" : "alarms"})` : "Rig";
    if (tab.textContent !== text) tab.textContent = text;
    tab.setAttribute("aria-label", open ? `Rig, ${open} open alarms` : "Rig");
  }

  /** Show the newest unacknowledged alarm in the bar. */
  head() {
    const unseen = this.alarms.filter((each) => each.acknowledged_at === null);
    byId("alarm-head").hidden = unseen.length === 0;
    show(byId("alarm-head"), [unseen], () => unseen.slice(0, 1).flatMap((each) => [
      chip(each.words, each.severity === "alarm" ? "bad" : "warn"),
      unseen.length > 1 ? h("span", { class: "muted" }, `and ${unseen.length - 1} more`) : null,
      this.button(each, "head-"),
    ]));
  }

  render(open, next) {
    show(this.panel, [this.alarms, this.all, open, next], () => [
      h("h2", { id: "alarms-title" }, open ? `Alarms (${open} open)` : "Alarms"),
      this.alarms.length ? this.table() : h("p", { class: "muted" },
        this.all ? "There has been no alarm." : "No alarm is open."),
      next === null ? null : left(`The newest ${MOST} are shown; pincette alarms --limit lists more.`),
      h("button", { type: "button", class: "quiet", id: "alarms-all", "aria-pressed": String(this.all),
        onclick: () => {
          this.all = !this.all;
          this.refresh().catch(() => {});
        } }, "Show earlier ones"),
    ]);
  }

  table() {
    return h("table", { class: "list stacked" },
      h("caption", { class: "unseen" }, "Alarms, the newest first"), headOf(["Last", "What", "Seen"]),
      h("tbody", {}, ...this.alarms.map((each) => this.row(each))));
  }

  row(each) {
    const tone = !each.open ? "muted" : each.severity === "alarm" ? "bad" : "warn";
    const ends = each.cleared_at === null ? ENDS[each.clears] : "";
    const notes = [each.count > 1 ? `${each.count} times` : "", each.job ? `job ${each.job}` : "", ends];
    return h("tr", { id: `alarm-${each.id}` },
      h("th", { scope: "row", class: "time" }, clock(each.last_at)),
      h("td", { class: "below" }, chip(each.words, tone),
        h("span", { class: "muted block" }, notes.filter(Boolean).join(", "))),
      h("td", { class: "figures" }, each.acknowledged_at === null ? this.button(each)
        : h("span", { class: "muted" }, each.acknowledged_by)));
  }

  button(each, where = "") {
    return h("button", { type: "button", id: `${where}acknowledge-${each.id}`, "data-needs": "operate",
      "aria-label": `Acknowledge: ${each.words}`,
      onclick: () => this.acknowledge(each.id) }, "Acknowledge");
  }

  async acknowledge(id) {
    this.said.textContent = "";
    try {
      await post(`/alarms/${id}/actions`, { type: "acknowledge" });
    } catch (problem) {
      this.said.textContent = told(problem);
    }
    await this.refresh().catch(() => {});
    this.refreshAll();
  }
}
