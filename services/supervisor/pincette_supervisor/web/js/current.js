// The job that has the rig: its phase, its progress, and its possible actions.

import { post, told } from "./api.js";
import { byId, chip, h, setText, show } from "./dom.js";
import { kindOf, mainFigure } from "./kinds.js";
import { clock, duration, now_s, number, plain, toneOfState } from "./words.js";

const ACTIONS = {
  start: "Start", pause: "Pause", resume: "Resume", continue: "Continue",
  release: "Release part", stop: "Stop", abort: "Abort",
  retry: "Retry", retry_at: "Retry at place", accept: "Accept result", give_up: "Give up",
  approve: "Approve", reject: "Reject",
};

/** States in which a job waits for a person, and makes no progress. */
const STILL = ["proposed", "awaiting_recovery"];

/** Share of the planned time that was played, and what is left of it. */
function course(progress) {
  if (!progress || progress.planned_s === null) return { percent: null, remaining_s: null };
  const percent = progress.percent ?? (100 * progress.elapsed_s) / progress.planned_s;
  const remaining_s = progress.remaining_s ?? progress.planned_s - progress.elapsed_s;
  return { percent: Math.min(100, Math.max(0, percent)), remaining_s: Math.max(0, remaining_s) };
}

export function outcomeOf(job) {
  const result = job.result ?? {};
  if (!result.outcome) return "";
  return plain(result.outcome);
}

/** What a stop does with the part of a job. */
function stopping({ kind, request }) {
  const { holds_part, on_stop } = kindOf(kind);
  if (!holds_part) return on_stop === "hold" ? "ends it where the arm is" : "ends it and releases a part";
  return { release: "releases the part", retract: "releases the part and retreats" }[request.on_stop]
    ?? "keeps a held part";
}

function summary(job) {
  const [label, text] = mainFigure(job);
  return (outcomeOf(job) || "no outcome") + (text === "–" ? "" : ` · ${label} ${text}`);
}

export class Current {
  constructor({ refresh, choose }) {
    this.refresh = refresh;
    this.choose = choose;
    this.said = "";
    this.asked = "";
    this.fault = h("p", { class: "fault", id: "current-fault", role: "alert" });
    this.sent = h("p", { class: "hint", id: "current-sent", role: "status" });
  }

  show(job, rig) {
    const progress = job?.progress;
    show(byId("current"), [job?.id, job?.state, job?.cause, job?.allowed_actions, job?.kind,
      job?.position, progress?.instruction, job?.result?.outcome, rig?.active_job],
    () => (job ? this.card(job) : this.empty()));
    if (job) this.update(job);
    const asks = progress?.instruction ?? "";
    // A request to a person is visible, wherever the panels were scrolled to.
    if (asks && asks !== this.asked) byId("current").scrollIntoView({ block: "nearest" });
    this.asked = asks;
  }

  empty() {
    return [h("h2", { id: "current-title" }, "No job yet"),
      h("p", { class: "muted" }, "Start one below; it shows here while it runs.")];
  }

  card(job) {
    const ended = job.ended_at !== null;
    const instruction = job.progress?.instruction;
    this.fault.textContent = "";
    this.sent.textContent = "";
    const buttons = job.allowed_actions.map((type) => h("button", {
      type: "button", id: `act-${type}`, "data-needs": "operate",
      class: type === "abort" ? "danger" : ["resume", "continue"].includes(type) ? "main" : "",
      "aria-describedby": ["stop", "abort"].includes(type) && !ended ? "current-hint" : null,
      onclick: () => this.act(job, type),
    }, ACTIONS[type] ?? plain(type)));
    return [
      h("div", { class: "card-head" },
        h("h2", { id: "current-title" }, `${ended ? "Last job" : "Job"}: ${plain(job.kind)}`),
        h("span", { id: "current-state" }, chip(plain(job.state), toneOfState(job.state)))),
      ended ? h("p", { class: "sum" }, summary(job)) : null,
      job.cause ? h("p", { class: "cause" }, job.cause) : null,
      instruction ? h("p", { class: "instruction", role: "status" }, instruction) : null,
      job.recovery ? h("p", { class: "instruction", role: "status", id: "recovery-wait" }) : null,
      job.allowed_actions.includes("retry_at") ? h("div", { class: "field" },
        h("label", { for: "retry-x" }, "Place for the retry", h("span", { class: "unit" }, "µm, to within 1 µm")),
        h("input", { id: "retry-x", type: "number", step: "any" })) : null,
      ended || STILL.includes(job.state) ? null : h("div", { class: "progress" },
        h("progress", { id: "bar", max: 100, "aria-labelledby": "course" }),
        h("p", { id: "course", class: "course" })),
      buttons.length ? h("div", { class: "buttons" }, ...buttons) : null,
      ended || !buttons.length ? null : h("p", { class: "hint", id: "current-hint" },
        job.state === "proposed" ? "It has not moved anything: Approve plans it again and starts or queues it."
          : job.position ? "It has not moved anything yet: Stop and Abort remove it from the queue."
          : `Stop ${stopping(job)}; Abort trips the actuator, which latches.`),
      this.sent, this.fault,
      h("p", { class: "muted small" },
        h("button", { type: "button", id: "current-open", class: "link",
          onclick: () => this.choose(job.id) }, job.id),
        ` · ${ended ? `ended ${clock(job.ended_at)}`
          : job.started_at ? `started ${clock(job.started_at)}` : `requested ${clock(job.created_at)}`}`),
    ];
  }

  /** What changes from sample to sample. */
  update(job) {
    const text = byId("course");
    const progress = job.progress;
    const { percent, remaining_s } = course(progress);
    if (text) {
      const words = [progress?.phase || plain(job.state)];
      if (job.position) words.push(`position ${job.position} in the queue`);
      if (percent !== null) words.push(`${number(percent, 0)} %`, `${duration(remaining_s)} left`);
      else if (progress) words.push(`${duration(progress.elapsed_s)}, until it is released`);
      setText(text, words.join(" · "));
      const bar = byId("bar");
      if (percent === null) bar.removeAttribute("value");
      else bar.value = percent;
    }
    const wait = byId("recovery-wait");
    if (wait && job.recovery) {
      const left_s = Math.max(0, Date.parse(job.recovery.until) / 1000 - now_s());
      setText(wait, `Waits for a decision (${plain(job.recovery.case)}): `
        + `${plain(job.recovery.default)} in ${duration(left_s)}`);
    }
    const said = `${plain(job.kind)} ${plain(job.state)}`
      + (progress?.phase && job.ended_at === null ? `, ${progress.phase}` : "")
      + (job.ended_at !== null ? `, ${outcomeOf(job)}` : "");
    if (said !== this.said) setText(byId("announce"), said);
    this.said = said;
  }

  async act(job, type) {
    this.fault.textContent = "";
    this.sent.textContent = `${ACTIONS[type] ?? plain(type)}: requested, not yet answered`;
    const asks = { type };
    if (type === "retry_at") {
      asks.place = { x_um: byId("retry-x").valueAsNumber, u_um: 1,
        measured_at: new Date(1000 * now_s()).toISOString(), source: "page" };
    }
    try {
      await post(`/jobs/${job.id}/actions`, asks);
    } catch (problem) {
      this.fault.textContent = told(problem);
    }
    this.sent.textContent = "";
    this.refresh();
  }
}
