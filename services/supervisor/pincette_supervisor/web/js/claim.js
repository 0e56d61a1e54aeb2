// Who has claimed the rig: others begin nothing there, everybody may stop. This page can claim it,
// give it back, or break the claim of somebody else.

import { claimSecret, RIG_PATH, sendClaim, told } from "./api.js";
import { byId, h, show } from "./dom.js";
import { clock, duration } from "./words.js";

const LEASE_S = 60;
const RENEW_MS = 20000;

export class Claim {
  constructor({ refresh }) {
    this.refreshAll = refresh;
    this.mine = claimSecret(false) !== null;
    this.said = h("p", { class: "fault", id: "claim-said", role: "alert" });
    this.place = h("div", { id: "claim" });
    byId("panel-rig").prepend(this.place);
    setInterval(() => this.mine && this.ask("PUT", { lease_s: LEASE_S, note: "page" }), RENEW_MS);
  }

  follow(rig) {
    const { claim } = rig;
    if (!claim) this.mine = false;
    const words = claim ? `${this.mine ? "this page" : claim.by}${claim.note && !this.mine ? ` (${claim.note})` : ""}`
      : "nobody";
    show(this.place, [words, this.mine, claim?.since], () => [
      h("h3", {}, "Claim"),
      h("p", {}, claim ? `Claimed by ${words} since ${clock(claim.since)}. Others begin nothing; everybody may stop.`
        : "Nobody has claimed the rig: whoever may operate it begins jobs."),
      h("div", { class: "buttons" }, this.button(claim)), this.said]);
  }

  button(claim) {
    const [id, text, act] = !claim ? ["claim-take", "Claim the rig", () => this.take()]
      : this.mine ? ["claim-return", "Give it back", () => this.drop(false)]
        : ["claim-break", `Break the claim of ${claim.by}`, () => this.drop(true)];
    return h("button", { type: "button", id, class: "quiet", "data-needs": "operate", onclick: act }, text);
  }

  async take() {
    claimSecret(true);
    this.mine = await this.ask("PUT", { lease_s: LEASE_S, note: "page" });
    this.refreshAll();
  }

  async drop(force) {
    await this.ask("DELETE", undefined, force ? "?force=true" : "");
    this.mine = false;
    this.refreshAll();
  }

  async ask(method, body, query = "") {
    this.said.textContent = "";
    try {
      await sendClaim(method, `${RIG_PATH}/claim${query}`, body);
      return true;
    } catch (problem) {
      this.said.textContent = told(problem);
      return false;
    }
  }
}

/** Who else has the rig, for the notices above the charts. */
export const claimedBy = (rig) => (rig.claim && claimSecret(false) === null
  ? [`${rig.claim.by}${rig.claim.note ? ` (${rig.claim.note})` : ""}, for another ${duration(Math.round(rig.claim.left_s))}`] : []);
