// The page: it requests the rig once a second and whenever an event reports a change.

import { admitted } from "./access.js";
import { Alarms } from "./alarms.js";
import { get, heard, jobsOfRig, RIG, RIG_PATH } from "./api.js";
import { Calibrations } from "./calibrations.js";
import { watchCamera } from "./camera.js";
import { Claim } from "./claim.js";
import { Charts } from "./plots/charts.js";
import { Checks } from "./checks.js";
import { rigAnswered, watchConnection } from "./connection.js";
import { Current } from "./current.js";
import { Details } from "./details.js";
import { byId } from "./dom.js";
import { StartForm } from "./form/form.js";
import { Jobs } from "./jobs.js";
import { kindOf, loadKinds } from "./kinds.js";
import { Queue } from "./queue.js";
import { Past } from "./plots/past.js";
import { Recent } from "./plots/recent.js";
import { installReset, showRig } from "./rig.js";
import { followRigs } from "./rigs.js";
import { install as installScope } from "./plots/scope.js";
import { SeriesPanel } from "./series.js";
import { Feed } from "./streams.js";
import { installTabs } from "./tabs.js";

// What the page scrolls to must not lie below the bar, whose height depends on the alarm in it.
new ResizeObserver(([{ target }]) => {
  document.documentElement.style.scrollPaddingTop = `${target.offsetHeight}px`;
}).observe(document.querySelector(".bar"));

const EVERY_MS = 1000;
const RUNNING_MS = 400;
const SOON_MS = 60;

const recent = new Recent();
const charts = new Charts(recent, new Past());
installScope(charts);

let rig = null;
let job = null;
let busy = false;
let again = false;
let started = false; // whether the kinds of jobs are known
let timer = 0;
let listed = "";

const choose = (id) => {
  openTab("tab-jobs");
  jobs.open(id).catch(() => {});
};
const current = new Current({ refresh: soon, choose });
const runAgain = (past) => {
  openTab("tab-start");
  form.again(past);
};
const jobs = new Jobs({ choose, again: runAgain });
const calibrations = new Calibrations({ refresh: soon });
const alarms = new Alarms({ refresh: soon });
const checks = new Checks();
const claim = new Claim({ refresh: soon });
const details = new Details({ refresh: soon });
const queue = new Queue({ refresh: soon, choose });
const form = new StartForm({ refresh: soon, started: (made) => { job = made; }, recent });
const series = new SeriesPanel({ refresh: soon, choose, request: () => form.request() });
const openTab = installTabs((id) => {
  if (id === "tab-jobs") jobs.refresh().catch(() => {});
  if (id === "tab-calibrations") calibrations.refresh().catch(() => {});
  if (id === "tab-rig") {
    alarms.refresh().catch(() => {});
    soon();
  }
});
installReset(soon);
watchConnection();
watchCamera();

/** Which job is to be shown: the one that has the rig, else the newest. */
async function newestJob() {
  if (rig.active_job) return get(`/jobs/${rig.active_job}`);
  if (job && job.ended_at === null) return get(`/jobs/${job.id}`);
  return (await jobsOfRig("limit=1")).jobs[0] ?? null;
}

async function refresh() {
  rig = await get(RIG_PATH);
  rigAnswered();
  const trip = alarms.tripOf(rig.latch);
  showRig(rig, trip);
  // The alarm of a trip is written after the trip, and its event may come while no stream is open.
  if (!trip && rig.allowed_actions.includes("reset") && alarms.expectsTrip(rig.latch)) {
    alarms.refresh().catch(() => {});
  }
  checks.follow(rig);
  claim.follow(rig);
  form.follow(rig);
  job = await newestJob();
  current.show(job, rig);
  charts.follow(rig, job);
  await queue.follow(rig);
  await details.follow(rig);
  // A job that has come, ended or moved in the queue changes the lists.
  const now = JSON.stringify([job?.id, job?.state, rig.queue?.length]);
  if (now === listed) return;
  listed = now;
  form.jog.changed(job);
  await jobs.refresh();
  await series.refresh();
  if (job && kindOf(job.kind).proposes && job.ended_at !== null) await calibrations.refresh();
}

/** The bar shows what the supervisor answers instead, or that it does not answer. */
function showTrouble(problem) {
  if (problem.status === undefined) {
    document.dispatchEvent(new CustomEvent("pincette:broken", { detail: problem.message }));
  }
  heard.trouble = problem.status ? problem.title : "";
}

/** Try again until the supervisor has answered. */
async function insist(ask) {
  for (;;) {
    try {
      return await ask();
    } catch (problem) {
      showTrouble(problem);
      await new Promise((go) => setTimeout(go, EVERY_MS));
    }
  }
}

/** One refresh at a time; requests in the meantime follow it. */
async function run() {
  clearTimeout(timer);
  if (!started) return;
  if (busy) {
    again = true;
    return;
  }
  busy = true;
  again = false;
  try {
    await refresh();
  } catch (problem) {
    showTrouble(problem);
  } finally {
    busy = false;
    const running = job && job.ended_at === null;
    const wait = again ? SOON_MS : document.hidden ? 5 * EVERY_MS : running ? RUNNING_MS : EVERY_MS;
    timer = setTimeout(run, wait);
  }
}

function soon() {
  if (busy) again = true;
  else {
    clearTimeout(timer);
    timer = setTimeout(run, SOON_MS);
  }
}

function followStreams() {
  new Feed({
    begun: () => recent.clear(),
    samples: (batch) => recent.push(batch),
    event: (event) => {
      if (event.kind === "alarm" || event.kind === "rig") alarms.refresh().catch(() => {});
      if (event.kind === "series") series.refresh().catch(() => {});
      if (event.kind !== "progress") soon();
      else if (job && event.job === job.id && job.progress) {
        job = { ...job, progress: { ...job.progress, ...event.body } };
        current.update(job);
      }
    },
  });
}

// A select that has the focus must not change while a person scrolls past it.
addEventListener("wheel", ({ target }) => {
  if (target === document.activeElement && target.tagName === "SELECT") target.blur();
}, { capture: true, passive: true });
document.documentElement.dataset.page = "live";
document.title = `${RIG} · pincette`;
byId("rig-name").textContent = RIG;
document.addEventListener("pincette:estop", soon);
document.addEventListener("visibilitychange", () => document.hidden || soon());
await admitted();
await insist(loadKinds);
started = true;
form.offer();
followStreams();
run();
alarms.refresh().catch(() => {});
form.prefill();
followRigs();
