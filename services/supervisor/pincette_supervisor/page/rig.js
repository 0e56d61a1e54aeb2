// The rig in the bar at the top: whether it answers, may start, holds a part, is latched.

import { heard, post, RIG } from "./api.js";
import { byId, chip, h, setText, show } from "./dom.js";
import { plain } from "./words.js";

const STALE_MS = 3000;

function fact(name, id, content) {
  return h("div", { class: "fact" }, h("dt", {}, name), h("dd", { id: `fact-${id}` }, content));
}

function safeToMove(rig) {
  const safe = rig.safe_to_move;
  if (!safe) return null;
  return fact("Stage", "stage", chip(safe.value ? "may move" : "must wait",
    safe.value ? "good" : "warn"));
}

function facts(rig) {
  const part = { none: ["none", "muted"], held: ["held", "busy"], unknown: ["unknown", "warn"] };
  const state = rig.latch.state;
  const trouble = rig.allowed_actions.includes("reset") || ["frozen", "ramping"].includes(state);
  // A latch that nobody has to clear says only that the rig was switched on.
  const quiet = ["latched", "unknown"].includes(state) ? "muted" : "good";
  const model = rig.model.version ? `version ${rig.model.version}` : "rig file";
  return [
    fact("Start", "start", chip(...start(rig))),
    fact("Part", "part", chip(...(part[rig.part] ?? [plain(rig.part), "warn"]))),
    safeToMove(rig),
    fact("Actuator", "latch", chip(plain(state), trouble ? "bad" : quiet)),
    fact("Model", "model", h("span", { title: rig.model.digest }, model)),
  ];
}

function start(rig) {
  if (rig.can_start) return ["can start", "good"];
  if (rig.active_job) return ["busy", "busy"];
  if (rig.startable?.length) return [`only ${rig.startable.join(" or ")}`, "warn"];
  return ["cannot start", "bad"];
}

/** Why nothing can start, what the stage waits for, and what a person should see to. */
function notices(rig) {
  const running = rig.active_job !== null;
  const latched = rig.allowed_actions.includes("reset");
  const groups = [
    [rig.startable?.length ? "Not every job can start" : "No job can start", running ? [] : rig.reasons.filter((reason) => !latched
      || !reason.startsWith("actuator: latched"))],
    ["The stage must wait", running ? [] : rig.safe_to_move?.reasons ?? []],
    ["See to it", rig.warnings ?? []],
    ["The queue is halted", rig.queue?.halted ? [rig.queue.halted] : []],
  ];
  return groups.filter(([, reasons]) => reasons.length);
}

function queueButtons(refresh) {
  const act = (type) => () => post(`/rigs/${RIG}/queue/actions`, { type }).then(refresh, refresh);
  return h("p", { class: "buttons" },
    h("button", { type: "button", id: "queue-resume", onclick: act("resume") }, "Resume queue"),
    h("button", { type: "button", id: "queue-clear", class: "quiet", onclick: act("clear") },
      "Clear queue"));
}

export function showRig(rig, refresh) {
  show(byId("facts"), [start(rig), rig.part, rig.safe_to_move?.value,
    rig.latch, rig.allowed_actions, rig.model], () => facts(rig));
  const groups = notices(rig);
  const halted = Boolean(rig.queue?.halted);
  byId("reasons").hidden = groups.length === 0;
  show(byId("reasons"), [groups, halted], () => [
    ...groups.map(([title, reasons]) => h("div", {}, h("h2", {}, title),
      h("ul", {}, ...reasons.map((reason) => h("li", {}, reason))))),
    halted ? queueButtons(refresh) : null,
  ]);
  showLatch(rig);
}

function showLatch(rig) {
  const latched = rig.allowed_actions.includes("reset");
  byId("latch").hidden = !latched;
  if (!latched) {
    openReset(false);
    return;
  }
  const cause = { estop: "emergency stop", boot: "the actuator was switched on" }[rig.latch.cause];
  setText(byId("latch-title"), `The actuator is ${plain(rig.latch.state)}`);
  setText(byId("latch-cause"), `Cause: ${cause ?? rig.latch.cause}. Nothing moves until a person `
    + `has reset the rig${rig.part === "held" ? "; a part is held" : ""}.`);
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

/** Reset asks for a person's word first; it covers nothing, so that E-STOP stays in reach. */
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
      await post(`/rigs/${RIG}/reset`, { acknowledge: true });
      byId("estop-said").hidden = true;
      openReset(false);
    } catch (problem) {
      setText(byId("reset-said"), `${problem.title}: ${problem.message}`);
    }
    refresh();
  });
}

/** Say when nothing has come for a while: what is shown is then old. */
export function watchConnection() {
  const said = byId("connection");
  setInterval(() => {
    const now = performance.now();
    const silent = now - heard.answer;
    const stale = silent > STALE_MS;
    document.body.classList.toggle("stale", stale);
    document.body.classList.toggle("still", now - heard.sample > STALE_MS);
    said.dataset.tone = stale ? "bad" : heard.ever ? "good" : "muted";
    if (stale) setText(said, `no answer for ${Math.floor(silent / 1000)} s`);
    else setText(said, heard.ever ? "connected" : "connecting");
  }, 500);
}
