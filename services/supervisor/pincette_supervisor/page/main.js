// The page: it asks for the rig once a second and whenever an event says that something changed.

import { get, RIG } from "./api.js";
import { Calibrations } from "./calibrations.js";
import { Charts } from "./charts.js";
import { Current } from "./current.js";
import { StartForm } from "./form.js";
import { Jobs } from "./jobs.js";
import { Recent } from "./recent.js";
import { installReset, showRig, watchConnection } from "./rig.js";
import { install as installScope } from "./scope.js";
import { follow } from "./streams.js";
import { installTabs } from "./tabs.js";

const EVERY_MS = 1000;
const RUNNING_MS = 400;
const SOON_MS = 60;

const recent = new Recent();
const charts = new Charts(recent);
installScope(charts);

let rig = null;
let job = null;
let busy = false;
let again = false;
let timer = 0;
let listed = "";

const choose = (id) => {
  openTab("tab-jobs");
  jobs.open(id).catch(() => {});
};
const current = new Current({ refresh: soon, choose });
const jobs = new Jobs({ choose });
const calibrations = new Calibrations({ refresh: soon });
const form = new StartForm({ refresh: soon, started: (made) => { job = made; } });
const openTab = installTabs((id) => {
  if (id === "tab-jobs") jobs.refresh().catch(() => {});
  if (id === "tab-calibrations") calibrations.refresh().catch(() => {});
});
installReset(soon);
watchConnection();

/** Which job is to be shown: the one that has the rig, else the newest. */
async function newestJob() {
  if (rig.active_job) return get(`/jobs/${rig.active_job}`);
  if (job && job.ended_at === null) return get(`/jobs/${job.id}`);
  if (job) return job;
  return (await get("/jobs?limit=1")).jobs[0] ?? null;
}

async function refresh() {
  rig = await get(`/rigs/${RIG}`);
  showRig(rig, soon);
  form.follow(rig);
  job = await newestJob();
  current.show(job, rig);
  // A job that has come, ended or moved in the queue changes the lists.
  const now = JSON.stringify([job?.id, job?.state, rig.queue?.length]);
  if (now === listed) return;
  listed = now;
  await jobs.refresh();
  if (job?.kind === "calibrate" && job.ended_at !== null) await calibrations.refresh();
}

/** One refresh at a time; what is asked for meanwhile comes after it. */
async function run() {
  clearTimeout(timer);
  if (busy) {
    again = true;
    return;
  }
  busy = true;
  again = false;
  try {
    await refresh();
  } catch {
    // The bar says that the supervisor does not answer.
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

follow({
  begun: () => recent.clear(),
  samples: (batch) => recent.push(batch),
  event: (event) => {
    if (event.kind !== "progress") soon();
    else if (job && event.job === job.id && job.progress) {
      job = { ...job, progress: { ...job.progress, ...event.body } };
      current.update(job);
    }
  },
});
document.addEventListener("pincette:estop", soon);
document.addEventListener("visibilitychange", () => document.hidden || soon());
run();
form.prefill();
