// Series: one request for many jobs. The form starts one; the panel shows and controls the newest.

import { BASE, freshKey, post, RIG, seriesOfRig, told } from "./api.js";
import { field } from "./description.js";
import { byId, chip, h, show } from "./dom.js";
import { duration } from "./words.js";

const TONES = { running: "busy", paused: "warn", stopped: "bad", completed: "good" };
const ACTIONS = { pause: "Pause", resume: "Resume", stop: "Stop series" };

export class SeriesPanel {
  /** `request` returns the request that all jobs of a new series have. */
  constructor({ refresh, request, choose }) {
    Object.assign(this, { refreshAll: refresh, request, choose });
    this.newest = null;
    this.followed = ""; // id of the series that was seen before its end
    this.key = freshKey();
    this.fault = h("p", { class: "fault", id: "series-fault", role: "alert" });
    byId("panel-start").append(this.form());
  }

  form() {
    const forget = () => this.forget();
    this.table = h("textarea", { id: "series-csv", rows: "4", spellcheck: "false", oninput: forget,
      placeholder: "sample,force_mN\nB1,8\nB2,12" });
    this.file = h("input", { type: "file", id: "series-file", accept: ".csv,text/csv",
      onchange: async () => {
        this.table.value = await this.file.files[0]?.text() ?? "";
        forget();
      } });
    const number = (id, label, value) => field(id, label, value, { inputmode: "numeric", oninput: forget });
    [this.nameRow, this.name] = field("series-name", "Name", "", { maxlength: "200", oninput: forget });
    [this.repeatsRow, this.repeats] = number("series-repeats", "Repeats", "1");
    [this.failuresRow, this.failures] = number("series-failures", "Stop after failures", "1");
    [this.pauseRow, this.pause] = number("series-pause", "Pause between jobs / s", "0");
    [this.seedRow, this.seed] = number("series-seed", "Shuffle with seed", "");
    this.said = h("p", { class: "fault", id: "series-said", role: "alert" });
    this.planned = h("p", { class: "hint", id: "series-planned", role: "status" });
    return h("details", { id: "series-new" }, h("summary", {}, "Series of such jobs"),
      h("form", { id: "series-form", novalidate: true, onsubmit: (event) => {
        event.preventDefault();
        this.start(false);
      } },
      h("p", { class: "hint" }, "All jobs have the request above. Each line of the table is a job, "
        + "with the members that the first line names; without a table all jobs are the same."),
      this.nameRow,
      h("div", { class: "field" }, h("label", { for: "series-csv" }, "Table"), this.table),
      h("div", { class: "field" }, h("label", { for: "series-file" }, "From a CSV file"), this.file),
      h("div", { class: "fields" }, this.repeatsRow, this.failuresRow, this.pauseRow, this.seedRow),
      this.said, this.planned,
      h("div", { class: "buttons" },
        h("button", { type: "submit", class: "main", id: "series-start", "data-needs": "operate" }, "Start series"),
        h("button", { type: "button", id: "series-dry-run", "data-needs": "operate",
          onclick: () => this.start(true) }, "Dry run of the series"))));
  }

  forget() {
    this.key = freshKey();
    this.said.textContent = "";
    this.planned.textContent = "";
  }

  body() {
    const whole = (input, empty) => (input.value.trim() === "" ? empty : Number(input.value.replace(",", ".")));
    return { rig: RIG, name: this.name.value.trim(), job: this.request(), csv: this.table.value,
      repeats: whole(this.repeats, 1), stop_after_failures: whole(this.failures, null),
      pause_s: whole(this.pause, 0), shuffle_seed: whole(this.seed, null) };
  }

  async start(dry) {
    this.said.textContent = "";
    this.planned.textContent = dry ? "Planning all jobs …" : "";
    try {
      const body = this.body();
      if (dry) {
        const { total, planned_s } = await post("/series", { ...body, dry_run: true });
        this.planned.textContent = `${total} jobs can be done${planned_s === null ? "" : ` in ${duration(planned_s)}`}. Nothing has moved.`;
        return;
      }
      const { id } = await post("/series", body, { "Idempotency-Key": this.key });
      this.followed = id;
      this.key = freshKey();
    } catch (problem) {
      this.planned.textContent = "";
      if (problem.status) this.key = freshKey();
      this.said.textContent = told(problem);
    }
    this.refreshAll();
    await this.refresh().catch(() => {});
  }

  async refresh() {
    const { series } = await seriesOfRig("limit=1");
    [this.newest] = [...series, null];
    if (this.newest && this.newest.state !== "completed") this.followed = this.newest.id;
    const shown = this.newest?.id === this.followed ? this.newest : null;
    byId("series").hidden = !shown;
    show(byId("series"), shown, () => (shown ? this.panel(shown) : []));
  }

  panel(each) {
    const left = each.remaining_s && each.state !== "completed" ? `, ${duration(each.remaining_s)} left` : "";
    const failed = each.failed ? `, ${each.failed} not succeeded` : "";
    const file = (path, text) => h("a", { href: `${BASE}${path}`, target: "_blank", rel: "noopener" }, text);
    return [
      h("div", { class: "card-head" }, h("h2", { id: "series-title" }, each.name || "Series"),
        chip(each.state, TONES[each.state])),
      h("p", { id: "series-progress" }, `${each.ended} of ${each.total} jobs ended${failed}${left}`),
      h("progress", { max: String(each.total), value: String(each.ended), "aria-labelledby": "series-progress" }),
      each.cause ? h("p", { class: each.state === "stopped" ? "cause" : "cause warn" }, each.cause) : null,
      h("div", { class: "buttons" }, ...each.allowed_actions.map((type) => h("button", { type: "button",
        id: `series-${type}`, class: type === "resume" ? "main" : "", "data-needs": "operate",
        onclick: () => this.act(each, type) }, ACTIONS[type]))),
      this.fault,
      h("p", { class: "muted" }, file(`/series/${each.id}/plot`, "Figure"), " · ",
        file(`/series/${each.id}/report`, "Report"), " · ",
        file(`/jobs/export.csv?label=series=${each.id}`, "Table (CSV)"),
        each.job ? [" · ", h("button", { type: "button", class: "link", id: "series-job",
          onclick: () => this.choose(each.job) }, "Newest job")] : null),
    ];
  }

  async act(each, type) {
    this.fault.textContent = "";
    try {
      await post(`/series/${each.id}/actions`, { type });
    } catch (problem) {
      this.fault.textContent = told(problem);
    }
    await this.refresh().catch(() => {});
    this.refreshAll();
  }
}
