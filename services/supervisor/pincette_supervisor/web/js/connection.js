// Whether the supervisor answers, and how old what is shown has become.

import { heard, RIG } from "./api.js";
import { byId, setText } from "./dom.js";
import { duration } from "./words.js";

const STALE_MS = 3000;
const LOOK_MS = 500;
const STOPS = "E-STOP is kept and sent until the actuator confirms it; pincette estop on the rig's "
  + "computer and the button of the supply stop at once.";

/** Announce a text to a screen reader at once, but not the same text twice. */
export function alarm(text) {
  setText(byId("announce-alarm"), text);
}

/** The supervisor has sent the state of the rig. */
export function rigAnswered() {
  if (performance.now() - heard.rig > STALE_MS) document.dispatchEvent(new CustomEvent("pincette:answers"));
  heard.rig = performance.now();
  heard.ever = true;
  heard.trouble = "";
}

function why() {
  if (heard.trouble) return `The supervisor does not report the state of ${RIG} (${heard.trouble}).`;
  return "The supervisor does not answer.";
}

/** Say when nothing has come for a while: what is shown is then old. */
export function watchConnection() {
  const said = byId("connection");
  const notice = byId("stale");
  let stale = false;
  setInterval(() => {
    if ("broken" in document.documentElement.dataset) return;
    const now = performance.now();
    const age_s = (now - heard.rig) / 1000;
    const before = stale;
    stale = now - heard.rig > STALE_MS;
    document.body.classList.toggle("stale", stale);
    document.body.classList.toggle("still", now - heard.sample > STALE_MS);
    said.dataset.tone = stale ? "bad" : heard.ever ? "good" : "muted";
    notice.hidden = !stale;
    if (stale) {
      setText(said, `no answer for ${duration(Math.floor(age_s))}`);
      const age = heard.ever ? `The values shown are ${duration(Math.floor(age_s))} old. ` : "";
      setText(notice, `${why()} ${age}${STOPS}`);
    } else setText(said, heard.ever ? "connected" : "connecting");
    if (stale !== before) alarm(stale ? `${why()} The values shown are old.` : "The supervisor answers.");
  }, LOOK_MS);
}
