// The rig in the bar at the top: whether it answers, may start, holds a part, is latched.

import { post, RIG_PATH, told } from "./api.js";
import { claimedBy } from "./claim.js";
import { alarm } from "./connection.js";
import { byId, chip, h, setText, show } from "./dom.js";
import { clock, duration, plain } from "./words.js";

const CAUSES = { estop: "emergency stop", boot: "the actuator was switched on" };

function fact(name, id, content) {
  return h("div", { class: "fact" }, h("dt", {}, name), h("dd", { id: `fact-${id}` }, content));
}

function safeToMove(rig) {
  const safe = rig.safe_to_move;
  if (!safe) return null;
  return fact("Gripper's stage", "stage", chip(safe.value ? "may move" : "do not move",
    safe.value ? "good" : "warn"));
}

/** A reported state, with its age if it is no longer known but believed. */
function trusted(text, certainty, age_s) {
  if (certainty !== "believed") return text;
  const age = Math.round(age_s ?? 0);
  return age ? `${text}, believed (${duration(age)} old)` : `${text}, believed`;
}

function stands(rig) {
  const standing = rig.standing ?? {};
  return {
    part: trusted(plain(rig.part), standing.part_certainty, standing.part_age_s),
    state: trusted(plain(rig.latch.state), standing.state_certainty, standing.state_age_s),
  };
}

function facts(rig) {
  const tone = { none: "muted", held: "busy" }[rig.part] ?? "warn";
  const state = rig.latch.state;
  const standing = stands(rig);
  const trouble = rig.allowed_actions.includes("reset") || ["frozen", "ramping"].includes(state);
  // A latch that no person has to clear means only that the rig was switched on.
  const quiet = ["switched_on", "unknown"].includes(state) ? "muted" : "good";
  const model = rig.model.version ? `calibrated, version ${rig.model.version}` : "values of the rig file";
  return [
    fact("Start", "start", chip(...start(rig))),
    fact("Part", "part", chip(standing.part, tone)),
    safeToMove(rig),
    fact("Actuator", "latch", chip(standing.state, trouble ? "bad" : quiet)),
    fact("Model of the arm", "model", h("span", { title: rig.model.digest }, model)),
  ];
}

/** Whether the rig can start a job, in words and a tone. */
export function start(rig) {
  if (rig.can_start) return ["can start", "good"];
  if (rig.startable.length) return [`only ${rig.startable.join(" or ")}`, "warn"];
  if (rig.active_job) return ["busy", "busy"];
  return ["cannot start", "bad"];
}

/** Why nothing can start, why the stage must not move, and what a person should see to. */
function notices(rig) {
  const running = rig.active_job !== null;
  const latched = rig.allowed_actions.includes("reset");
  const groups = [
    [rig.startable.length ? "Not every job can start" : "No job can start",
      running || (latched && rig.reasons.length === 1) ? [] : rig.reasons],
    // The cause of the latch is shown in one place, by showLatch.
    ["Do not move the stage that carries the gripper", running || latched ? [] : rig.safe_to_move?.reasons ?? []],
    ["Claimed by another client", claimedBy(rig)],
    ["Needs attention", rig.warnings ?? []],
  ];
  return groups.filter(([, reasons]) => reasons.length);
}

/** Show the rig in the bar and in notices; `trip` is the alarm of the trip that latches it, or null. */
export function showRig(rig, trip) {
  show(byId("facts"), [start(rig), stands(rig), rig.safe_to_move?.value,
    rig.latch, rig.allowed_actions, rig.model], () => facts(rig));
  const groups = notices(rig);
  byId("reasons").hidden = groups.length === 0;
  show(byId("reasons"), groups, () => groups.map(([title, reasons]) => h("div", {}, h("h2", {}, title),
    h("ul", {}, ...reasons.map((reason) => h("li", {}, reason))))));
  showLatch(rig, trip);
}

/** Say that the stage must not move, and why unless the latch is the reason. */
function stageWaits(rig) {
  if (rig.safe_to_move.value) return "";
  const words = " Do not move the gripper's stage";
  return rig.latch.state === "latched" ? `${words} until then.`
    : `${words}: ${rig.safe_to_move.reasons.join("; ")}.`;
}

/** Return the cause of the latch as text, with its requester and time if they are known. */
function causeOf(latch, trip) {
  const cause = CAUSES[latch.cause] ?? (latch.words || latch.cause);
  if (!trip) return cause;
  const more = trip.words.startsWith(latch.words) ? trip.words.slice(latch.words.length) : "";
  return `${cause}${more}, at ${clock(trip.last_at)}`;
}

function showLatch(rig, trip) {
  const latched = rig.allowed_actions.includes("reset");
  const before = !byId("latch").hidden;
  byId("latch").hidden = !latched;
  if (!latched) {
    if (before) alarm("The latch of the actuator is cleared.");
    openReset(false);
    return;
  }
  setText(byId("latch-title"), `The actuator is ${plain(rig.latch.state)}`);
  setText(byId("latch-cause"), `Cause: ${causeOf(rig.latch, trip)}. Nothing moves until a person `
    + `has reset the rig${rig.part === "held" ? "; a part is held" : ""}.${stageWaits(rig)}`);
  if (!before) alarm(`${byId("latch-title").textContent}. ${byId("latch-cause").textContent}`);
}

function openReset(open) {
  byId("reset").hidden = !open;
  byId("reset-open").hidden = open;
  byId("reset-open").setAttribute("aria-expanded", String(open));
  if (!open) {
    byId("reset").reset();
    setText(byId("reset-said"), "");
  }
}

/** Reset asks for a confirmation first; the dialogue covers nothing, so E-STOP stays reachable. */
export function installReset(refresh) {
  byId("reset-open").addEventListener("click", () => {
    openReset(true);
    byId("reset-seen").focus();
  });
  byId("reset-cancel").addEventListener("click", () => {
    openReset(false);
    byId("reset-open").focus();
  });
  byId("reset").addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      await post(`${RIG_PATH}/reset`, { acknowledge: true });
      byId("estop-said").hidden = true;
      openReset(false);
    } catch (problem) {
      setText(byId("reset-said"), told(problem));
    }
    refresh();
  });
}
