// The list of jobs, and one of them with its result, its pictures and its files.

import { BASE, daysOfRig, get, jobsOfRig } from "./api.js";
import { outcomeOf } from "./current.js";
import { describe, factsOf, saidIn, saidOf } from "./description.js";
import { byId, chip, h, headOf, left, loading, show } from "./dom.js";
import { assumedOf, figuresOf, kindOf, kinds, mainFigure } from "./kinds.js";
import { Comparison, MOST as COMPARED } from "./plots/compare.js";
import { clock, number, plain, toneOfState } from "./words.js";

const PAGE = 30;
const TYPED_MS = 250;
/** Value, label, and the days ago at whose midnights they begin and end, by the rig's computer. */
const PERIODS = [["", "any time", null, null], ["today", "today", 0, null], ["yesterday", "yesterday", 1, 0],
  ["week", "last 7 days", 7, null], ["month", "last 30 days", 30, null]];
const MOST = 480;

export class Jobs {
  /** `choose` shows a job by its id; `again` offers the request of a job once more. */
  constructor({ choose, again }) {
    Object.assign(this, { choose, again });
    this.jobs = [];
    this.chosen = null;
    this.artifacts = null;
    this.limit = PAGE;
    this.more = false;
    this.asked = 0;
    this.compared = new Map();
    this.comparison = new Comparison();
    this.compare = h("button", { type: "button", id: "compare", disabled: true,
      onclick: () => this.comparison.show([...this.compared.values()]) });
    byId("panel-jobs").append(this.search(), h("div", { id: "job-detail" }), this.compare,
      h("div", { id: "job-list" }, loading()));
    this.nameCompared();
  }

  /** Choose a job to be compared with others, or no more. */
  pick(job, chosen) {
    if (chosen) this.compared.set(job.id, job);
    else this.compared.delete(job.id);
    this.nameCompared();
    this.render();
  }

  nameCompared() {
    const { size } = this.compared;
    this.compare.disabled = size < 2;
    this.compare.textContent = size < 2 ? "Tick two or more jobs to compare them" : `Compare ${size} jobs`;
  }

  /** What jobs are looked for; the list follows as it is typed. */
  search() {
    const find = () => {
      this.limit = PAGE;
      clearTimeout(this.typed);
      this.typed = setTimeout(() => this.refresh().catch(() => {}), TYPED_MS);
    };
    return h("form", { id: "job-search", class: "search", role: "search", onsubmit: (event) => {
      event.preventDefault();
      find();
    } },
    h("label", { class: "unseen", for: "job-text" }, "Find jobs by sample, batch, label, notes, id, cause or sender"),
    h("input", { id: "job-text", type: "text", role: "searchbox", maxlength: "200", oninput: find, autocomplete: "off",
      placeholder: "Sample, batch, label, notes, id, cause, sender" }),
    select("job-when", "Taken", PERIODS.map(([value, label]) => [value, label]), find),
    select("job-kind", "Kind", [["", "every kind"]], find),
    h("p", { class: "hint", id: "job-days" }));
  }

  async query() {
    const kind = byId("job-kind");
    if (kind.options.length === 1) kind.append(...kinds().map(({ name, label }) => h("option", { value: name }, label)));
    const asked = new URLSearchParams({ limit: this.limit });
    const text = byId("job-text").value.trim();
    if (text) asked.set("text", text);
    if (byId("job-kind").value) asked.set("kind", byId("job-kind").value);
    const [, , from, to] = PERIODS.find(([value]) => value === byId("job-when").value);
    const days = from === null ? null : await daysOfRig();
    if (from !== null) asked.set("created_from", days.midnights[from]);
    if (to !== null) asked.set("created_to", days.midnights[to]);
    byId("job-days").textContent = days ? `Days of the rig's computer, where it is ${
      days.now.slice(0, 16).replace("T", " ")} ${days.zone} (UTC${days.now.slice(19)}).` : "";
    this.narrowed = [...asked.keys()].length > 1;
    return asked;
  }

  async refresh() {
    this.asked += 1;
    const mine = this.asked;
    const query = await this.query();
    if (mine !== this.asked) return this.jobs;
    const { jobs, next } = await jobsOfRig(query);
    if (mine !== this.asked) return this.jobs;
    this.jobs = jobs;
    this.more = next !== null;
    this.render();
    await this.refreshChosen();
    return jobs;
  }

  async open(id) {
    this.chosen = id;
    this.artifacts = null;
    this.render();
    await this.refreshChosen();
    byId("job-title")?.focus();
  }

  /** The chosen job may be older than the list; its files come once it has ended. */
  async refreshChosen() {
    if (!this.chosen) return;
    let job = this.jobs.find((each) => each.id === this.chosen);
    if (!job) job = await get(`/jobs/${this.chosen}`);
    this.shown = job;
    if (job?.ended_at && this.artifacts?.job !== job.id) {
      const { artifacts } = await get(`/jobs/${job.id}/artifacts`);
      this.artifacts = { job: job.id, list: artifacts };
    }
    this.render();
  }

  /** A job after its description was edited. */
  take(changed) {
    this.jobs = this.jobs.map((job) => (job.id === changed.id ? changed : job));
    this.shown = changed;
    this.artifacts = null;
    this.refreshChosen().catch(() => {});
  }

  render() {
    const rows = this.jobs.map((job) => [job.id, job.kind, job.state, job.ended_at === null, outcomeOf(job), mainFigure(job)[1],
      clock(begunAt(job)), job.position ?? null, saidOf(job)]);
    show(byId("job-list"), [rows, this.chosen, this.more, this.narrowed, [...this.compared.keys()]], () => this.table());
    const job = this.jobs.find((each) => each.id === this.chosen)
      ?? (this.shown?.id === this.chosen ? this.shown : null);
    show(byId("job-detail"), [job ? { ...job, progress: null } : null, this.artifacts],
      () => (job ? this.detail(job) : this.chosen ? loading() : []));
  }

  table() {
    if (!this.jobs.length) {
      return h("p", { class: "muted" }, this.narrowed ? "No such job." : "No job yet.");
    }
    const head = ["Compare", "Time", "Job", "State and description", "Result"];
    return [h("table", { class: "list stacked jobs" },
      h("caption", { class: "unseen" }, "Jobs, the newest first"), headOf(head),
      h("tbody", {}, ...this.jobs.map((job) => this.row(job)))),
    this.more ? this.older() : null];
  }

  older() {
    if (this.limit >= MOST) return left(`${MOST} jobs are shown: search for older ones.`);
    return h("button", { type: "button", class: "quiet", id: "older", onclick: () => {
      this.limit += PAGE;
      this.refresh().catch(() => {});
    } }, "Show older jobs");
  }

  row(job) {
    const outcome = outcomeOf(job);
    const place = job.position ? ` ${job.position}` : "";
    const picked = this.compared.has(job.id);
    return h("tr", { class: job.id === this.chosen ? "chosen" : "" },
      h("td", { class: "pick" }, job.ended_at === null ? null : h("input", { type: "checkbox", id: `pick-${job.id}`,
        checked: picked, disabled: !picked && this.compared.size >= COMPARED,
        "aria-label": `Compare ${plain(job.kind)} of ${clock(begunAt(job))}`,
        onchange: (event) => this.pick(job, event.target.checked) })),
      h("td", { class: "time" }, h("button", { type: "button", class: "link", id: `open-${job.id}`,
        "aria-label": `Show ${plain(job.kind)} of ${clock(begunAt(job))}`,
        "aria-pressed": String(job.id === this.chosen),
        onclick: () => this.choose(job.id) }, clock(begunAt(job)))),
      h("td", {}, plain(job.values?.[kindOf(job.kind).variant_field] ?? job.kind)),
      h("td", { class: "below" }, chip(plain(job.state) + place, toneOfState(job.state)), " ", outcome,
        saidOf(job) ? h("span", { class: "muted block" }, ...saidIn(job)) : null),
      h("td", { class: "figures" }, mainFigure(job)[1]));
  }

  detail(job) {
    const files = this.artifacts?.job === job.id ? this.artifacts.list : [];
    const pictures = files.filter((file) => ["image/png", "image/jpeg"].includes(file.media_type));
    const place = (file) => `${BASE}/jobs/${job.id}/artifacts/${encodeURIComponent(file.name)}`;
    const facts = [...factsOf(job), ...figuresOf(job), ...losses(job)].map(([label, text]) => h("div", {},
      h("dt", {}, label), h("dd", {}, ...unbroken(text))));
    const assumed = assumedOf(job);
    const [label, main] = mainFigure(job);
    return h("article", { class: "detail", "aria-labelledby": "job-title" },
      h("h3", { id: "job-title", tabindex: "-1" }, `${plain(job.kind)} ${job.id}`),
      h("p", {}, chip(plain(job.state), toneOfState(job.state)), " ", outcomeOf(job)),
      label ? h("p", { class: "sum" }, `${label} ${main}`) : null,
      h("p", { class: "muted", id: "job-times" }, timesOf(job)),
      job.by ? h("p", { class: "muted" }, `Requested by ${job.by}`) : null,
      job.traceparent ? h("p", { class: "muted", id: "job-trace" },
        `Trace ${job.traceparent.split("-")[1]}`) : null,
      job.cause ? h("p", { class: "cause" }, job.cause) : null,
      job.record_detail ? h("p", { class: "cause" }, `Record: ${job.record_detail}`) : null,
      h("p", { class: "buttons" }, h("button", { type: "button", id: "job-again", "data-needs": "operate",
        onclick: () => this.again(job) }, "Run again…"),
      job.ended_at === null ? null : h("button", { type: "button", id: "job-charts",
        onclick: () => this.comparison.show([job]) }, "Show in the charts")),
      ...pictures.map((file) => h("a", { href: place(file), target: "_blank", rel: "noopener" },
        h("img", { src: place(file), class: "picture", loading: "lazy",
          alt: shows(job, file.name) }))),
      facts.length ? h("dl", { class: "figures-list" }, ...facts) : null,
      assumed.length ? h("p", { class: "muted small assumed" },
        `Assumed, since not calibrated: ${assumed.join(", ")}`) : null,
      this.actions(job),
      describe(job, (changed) => this.take(changed)),
      files.length ? h("ul", { class: "files", "aria-label": "Files of the record" },
        ...files.map((file) => h("li", {}, h("a", { href: place(file), target: "_blank",
          rel: "noopener" }, file.name), h("span", { class: "muted" }, size(file.bytes))))) : null);
  }

  actions(job) {
    if (!job.actions.length) return null;
    return h("details", { id: "job-actions" }, h("summary", {}, `Actions (${job.actions.length})`),
      h("ul", { class: "plain" }, ...job.actions.map((each) => h("li", {},
        `${clock(each.requested_at)} ${each.type} by ${each.by}`
        + (each.seq === null ? "" : `, acted at sample ${each.seq}`)))));
  }
}

function select(id, name, options, onchange) {
  return h("select", { id, "aria-label": name, onchange },
    ...options.map(([value, label]) => h("option", { value }, label)));
}

/** What a picture of a record shows. */
function shows(job, name) {
  const moment = /^camera-(\w+)\.jpg$/.exec(name);
  return moment ? `Camera at ${moment[1]}` : `${plain(job.kind)}: position, force and voltage over time`;
}

/** Time at which a job began to move, or at which it was requested while it waits. */
function begunAt(job) {
  return job.started_at ?? job.created_at;
}

/** Times at which a job was requested, began and ended. */
function timesOf(job) {
  return [["requested", job.created_at], ["started", job.started_at], ["ended", job.ended_at]]
    .filter(([, at]) => at)
    .map(([text, at]) => `${text} ${clock(at)}`)
    .join(" · ");
}

/** A text in which no unit such as mN/µm is broken at its slash. */
function unbroken(text) {
  return text.split(/(\S{1,5}\/\S{1,5})(?!\S)/).map((part, place) => (place % 2 ? h("span", { class: "whole" }, part) : part));
}

/** Samples and messages that a result lacks. */
function losses({ result }) {
  return [["missed_ticks", "Missed ticks"], ["dropped_messages", "Dropped messages"]]
    .filter(([name]) => typeof result?.[name] === "number")
    .map(([name, label]) => [label, String(result[name])]);
}

function size(bytes) {
  return bytes < 1e6 ? `${number(bytes / 1e3, 1)} kB` : `${number(bytes / 1e6, 1)} MB`;
}
