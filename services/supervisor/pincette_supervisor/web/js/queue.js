// The jobs that wait for the rig, in their order; why none begins, and what a person may do. And
// the jobs that wait for an approval.

import { jobsOfRig, post, RIG_PATH, told } from "./api.js";
import { byId, h, left, show } from "./dom.js";
import { asked } from "./kinds.js";
import { clock } from "./words.js";

export class Queue {
  constructor({ refresh, choose }) {
    this.refreshAll = refresh;
    this.choose = choose;
    this.known = "";
    this.waiting = [];
    this.proposed = [];
    this.fault = h("p", { class: "fault", id: "queue-fault", role: "alert" });
  }

  /** Update from the rig; the jobs are requested only if the queue has changed. */
  async follow(rig) {
    const { queue } = rig;
    const now = JSON.stringify([queue, rig.active_job]);
    if (now !== this.known) {
      this.proposed = queue.proposed ? (await jobsOfRig("state=proposed&limit=50")).jobs.reverse() : [];
      this.waiting = queue.length ? (await jobsOfRig("state=queued&limit=50")).jobs
        .filter((job) => job.position !== null).sort((a, b) => a.position - b.position) : [];
      this.known = now;
    }
    byId("queue").hidden = !queue.length && !queue.halted && !queue.proposed;
    show(byId("queue"), [queue, this.proposed.map((job) => job.id), this.waiting.map((job) => [job.id, job.position]),
      rig.allowed_actions], () => this.panel(queue, rig.allowed_actions));
  }

  panel(queue, allowed) {
    const order = (type, text) => h("button", { type: "button", id: `queue-${type}`,
      "data-needs": "operate",
      class: type === "resume" ? "main" : "",
      onclick: () => this.ask(`${RIG_PATH}/queue/actions`, type) }, text);
    return [
      h("div", { class: "card-head" }, h("h2", { id: "queue-title" }, "Queue"),
        h("span", { class: "muted" }, `${queue.length} of ${queue.capacity}`)),
      queue.halted ? h("p", { class: "cause warn", id: "queue-halted" }, `Halted: ${queue.halted}`)
        : null,
      h("ol", { class: "queue" }, ...this.waiting.map((job) => this.row(job))),
      queue.length > this.waiting.length ? left(`${queue.length - this.waiting.length} more wait.`) : null,
      h("div", { class: "buttons" },
        allowed.includes("resume_queue") ? order("resume", "Resume the queue") : null,
        allowed.includes("clear_queue") ? order("clear", "Clear the queue") : null),
      this.proposed.length ? h("h3", { id: "proposed-title" }, "Waits for approval") : null,
      h("ul", { class: "queue" }, ...this.proposed.map((job) => this.proposal(job))),
      this.fault,
    ];
  }

  proposal(job) {
    const button = (type, text) => h("button", { type: "button", id: `${type}-${job.id}`,
      "data-needs": "operate", "aria-label": `${text} ${asked(job)}, proposed by ${job.by}`,
      onclick: () => this.ask(`/jobs/${job.id}/actions`, type) }, text);
    return h("li", { class: "proposed" }, h("button", { type: "button", class: "link", id: `wait-${job.id}`,
      onclick: () => this.choose(job.id) }, asked(job)),
    h("span", { class: "muted" }, `by ${job.by}, until ${clock(job.approval_until)}`),
    button("approve", "Approve"), button("reject", "Reject"));
  }

  row(job) {
    return h("li", {}, h("b", { class: "place" }, String(job.position)),
      h("button", { type: "button", class: "link", id: `wait-${job.id}`,
        onclick: () => this.choose(job.id) }, asked(job)),
      h("span", { class: "muted" }, clock(job.created_at)),
      job.position > 1 ? h("button", { type: "button", class: "quiet", id: `first-${job.id}`,
        "data-needs": "operate", "aria-label": `Move ${asked(job)}, position ${job.position}, to the front`,
        onclick: () => this.ask(`${RIG_PATH}/queue/actions`, "move", { job: job.id, position: 1 }) },
      "First") : null,
      h("button", { type: "button", class: "quiet", id: `drop-${job.id}`, "data-needs": "operate",
        "aria-label": `Remove ${asked(job)}, position ${job.position}, from the queue`,
        onclick: () => this.ask(`/jobs/${job.id}/actions`, "stop") }, "Remove"));
  }

  async ask(path, type, more = {}) {
    this.fault.textContent = "";
    try {
      await post(path, { type, ...more });
    } catch (problem) {
      this.fault.textContent = told(problem);
    }
    this.refreshAll();
  }
}
