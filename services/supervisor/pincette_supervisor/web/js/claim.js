// The claim of the rig: other clients begin nothing, but all may stop. This page can claim it,
// give it back, or break the claim of another client.

import { claimSecret, forgetClaim, RIG_PATH, sendClaim, told } from "./api.js";
import { byId, h, show } from "./dom.js";
import { clock, duration } from "./words.js";

const LEASE_S = 60;
const RENEW_MS = 20000;
const OLDEST_MS = 5000; // of an answer about the rig: one from before the claim does not end it
let since = null; // when this page's claim began,
let renewed = 0; // and when it was last confirmed
const isMine = (claim) => claimSecret(false) !== null && claim?.since === since;

export class Claim {
  constructor({ refresh }) {
    this.refreshAll = refresh;
    this.said = h("p", { class: "fault", id: "claim-said", role: "alert" });
    this.place = h("div", { id: "claim" });
    byId("panel-rig").prepend(this.place);
    const renew = () => claimSecret(false) !== null && this.renew();
    setInterval(renew, RENEW_MS);
    renew();
  }

  follow(rig) {
    const { claim } = rig;
    const mine = isMine(claim);
    if (since !== null && !mine && Date.now() - renewed > OLDEST_MS) this.lose();
    const words = !claim ? "nobody" : mine ? "this page" : `${claim.by}${claim.note ? ` (${claim.note})` : ""}`;
    show(this.place, [words, mine, claim?.since], () => [
      h("h3", {}, "Claim"),
      h("p", {}, claim ? `Claimed by ${words} since ${clock(claim.since)}. Others cannot start jobs; everybody can stop.`
        : "The rig is not claimed: everybody who may operate it can start jobs."),
      h("div", { class: "buttons" }, this.button(claim, mine)), this.said]);
  }

  button(claim, mine) {
    const [id, text, act] = !claim ? ["claim-take", "Claim the rig", () => this.take()]
      : mine ? ["claim-return", "Return the claim", () => this.drop(false)]
        : ["claim-break", `Break the claim of ${claim.by}`, () => this.drop(true)];
    return h("button", { type: "button", id, class: "quiet", "data-needs": "operate", onclick: act }, text);
  }

  async take() {
    claimSecret(true);
    await this.renew();
    this.refreshAll();
  }

  async renew() {
    const claim = await this.ask("PUT", { lease_s: LEASE_S, note: "page" });
    if (claim) [since, renewed] = [claim.since, Date.now()];
  }

  lose() {
    since = null;
    forgetClaim();
  }

  async drop(force) {
    await this.ask("DELETE", undefined, force ? "?force=true" : "");
    this.refreshAll();
  }

  async ask(method, body, query = "") {
    this.said.textContent = "";
    try {
      return await sendClaim(method, `${RIG_PATH}/claim${query}`, body);
    } catch (problem) {
      this.said.textContent = told(problem);
      return null;
    }
  }
}

/** Name of another client that has claimed the rig, for the notices above the charts. */
export const claimedBy = (rig) => (rig.claim && !isMine(rig.claim)
  ? [`${rig.claim.by}${rig.claim.note ? ` (${rig.claim.note})` : ""}, for another ${duration(Math.round(rig.claim.left_s))}`] : []);
