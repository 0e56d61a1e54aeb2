// The rigs of a supervisor that serves several: the choice of one, each with an address of its own, and
// an overview of all.

import { get, RIG } from "./api.js";
import { byId, chip, h, headOf, show } from "./dom.js";
import { start } from "./rig.js";
import { force, number, plain, toneOfState, withUnit } from "./words.js";

const SEVERAL_MS = 3000;
const ALONE_MS = 30000;

const address = (name) => `?rig=${encodeURIComponent(name)}`;

function link(rig) {
  return h("a", { href: address(rig.name), id: `rig-${rig.name}`,
    "aria-current": rig.name === RIG ? "page" : null },
  h("b", {}, rig.name), chip(...start(rig)));
}

/** Show the rigs where there is a choice; say so where the chosen one is none of them. */
function offer(rigs) {
  const known = rigs.some((rig) => rig.name === RIG);
  const several = rigs.length > 1 || !known;
  byId("rigs").hidden = !several;
  byId("estop-rig").hidden = !several;
  show(byId("rigs"), [several, rigs.map((rig) => [rig.name, start(rig)])], () => (several ? [
    known ? null : h("p", { class: "fault", role: "alert" },
      `This supervisor has no rig ${RIG}; choose one:`),
    ...rigs.map(link), rigs.length > 1 ? overviewButton() : null] : []));
  return several;
}

function overviewButton() {
  return h("button", { type: "button", class: "quiet", id: "overview-open", "aria-controls": "overview",
    "aria-pressed": String(!byId("overview").hidden), onclick: (event) => {
      byId("overview").hidden = !byId("overview").hidden;
      event.target.setAttribute("aria-pressed", String(!byId("overview").hidden));
      followRigs();
    } }, "All rigs");
}

/** State of every rig, one a row. */
async function overview(rigs) {
  const jobs = await Promise.all(rigs.map((rig) => (rig.active_job ? get(`/jobs/${rig.active_job}`) : null)));
  const { alarms } = await get("/alarms?open=true&limit=200");
  const rows = rigs.map((rig, place) => row(rig, jobs[place], alarms.filter((each) => each.rig === rig.name)));
  const head = ["Rig", "Start", "Job", "Part", "Actuator", "Position", "Force", "Alarms"];
  show(byId("overview"), rows.map((each) => each.map(([, text]) => text)), () => [
    h("h2", { id: "overview-title" }, "All rigs"),
    h("div", { class: "wide" }, h("table", { class: "list" },
      h("caption", { class: "unseen" }, "State of every rig"),
      headOf(head),
      h("tbody", {}, ...rows.map((each, place) => h("tr", { id: `overview-${rigs[place].name}`,
        class: rigs[place].name === RIG ? "chosen" : "" },
      ...each.map(([make]) => h("td", {}, make())))))))]);
}

/** Cells, each with the function that makes it and its text. */
function row(rig, job, alarms) {
  const worst = alarms.some((each) => each.severity === "alarm") ? "bad" : "warn";
  const said = (text, tone) => [() => chip(text, tone), [text, tone]];
  const bare = (text) => [() => h("span", {}, text), text];
  const percent = job?.progress?.percent;
  const share = percent === null || percent === undefined ? "" : `, ${number(percent, 0)} %`;
  const phase = job?.progress?.phase ? `, ${job.progress.phase}` : "";
  return [
    [() => h("a", { href: address(rig.name) }, h("b", {}, rig.name)), rig.name],
    said(...start(rig)),
    job ? said(`${plain(job.kind)} ${plain(job.state)}${phase}${share}`, toneOfState(job.state)) : bare("–"),
    said(plain(rig.part), { none: "muted", held: "busy" }[rig.part] ?? "warn"),
    said(plain(rig.latch.state), rig.allowed_actions.includes("reset") ? "bad" : "muted"),
    bare(withUnit(rig.newest?.x_um, "µm")),
    bare(force(rig.newest?.force_mN, rig.newest?.force_uncertainty_mN)),
    alarms.length ? said(`${alarms.length} open`, worst) : bare("none"),
  ];
}

let timer = 0;

/** Poll the rigs, more often if there are several. */
export async function followRigs() {
  clearTimeout(timer);
  let several = false;
  try {
    const { rigs } = await get("/rigs");
    several = offer(rigs);
    if (several && !byId("overview").hidden) await overview(rigs);
  } catch {
    // The bar states that the supervisor does not answer.
  }
  clearTimeout(timer);
  timer = setTimeout(followRigs, several && !document.hidden ? SEVERAL_MS : ALONE_MS);
}
