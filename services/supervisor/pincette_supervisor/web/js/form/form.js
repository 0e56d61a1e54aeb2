// Starting a job: fields by kind, a dry run, and the start itself.

import { may } from "../access.js";
import { faultsOf, freshKey, get, planOf, startJob, startKept, told } from "../api.js";
import { field, SAID } from "../description.js";
import { byId, h, setText } from "../dom.js";
import { Fields } from "./fields.js";
import { Jog } from "./jog.js";
import { defaultsOf, kindsFor, plannedFields } from "../kinds.js";
import { PlanView } from "./plan.js";
import { plain, withoutUnit } from "../words.js";

/** Members of a request that the form states outside its fields, or sets for each job. */
const ELSEWHERE = ["kind", "rig", "autostart", "queue", "dry_run", "approval_s", ...SAID.map(([name]) => name)];

export class StartForm {
  constructor({ refresh, started, recent }) {
    this.refresh = refresh;
    this.started = started;
    this.key = freshKey();
    this.defaults = {};
    this.sources = { recipes: [] };
    this.rig = null;
    this.fields = new Fields();
    this.plan = new PlanView();
    this.jog = new Jog({ recent, refresh, started, take: (values) => {
      this.fields.set(values);
      this.forget();
    } });
    this.build();
  }

  build() {
    this.kind = h("select", { id: "kind", name: "kind", "aria-describedby": "kind-hint",
      onchange: () => this.choose(this.kind.value) });
    this.hint = h("p", { class: "hint", id: "kind-hint" });
    this.fault = h("p", { class: "fault", id: "start-said", role: "alert" });
    this.filled = h("p", { class: "hint", id: "start-filled", role: "status" });
    this.queue = h("input", { type: "checkbox", id: "field-queue", onchange: () => this.forget() });
    this.said = SAID.map(([name, label]) => [name,
      ...field(`field-${name}`, label, "", { oninput: () => this.forget() })]);
    const [sample, ...others] = this.said.map(([, row]) => row);
    this.button = h("button", { type: "submit", class: "main", id: "start",
      "data-needs": "operate" }, "Start");
    this.form = h("form", { id: "start-form", novalidate: true },
      h("div", { class: "field" }, h("label", { for: "kind" }, "Job"), this.kind, this.hint),
      this.filled,
      this.fields.element, this.fields.more,
      sample, h("details", { id: "say-more" }, h("summary", {}, "Batch, operator, notes"), ...others),
      h("label", { class: "check", id: "queue-line", hidden: true }, this.queue,
        h("span", {}, "Wait in the queue until the rig is free")),
      h("div", { class: "go" }, this.fault, h("div", { class: "buttons" }, this.button,
        h("button", { type: "button", id: "dry-run", "data-needs": "propose", onclick: () => this.dryRun() }, "Dry run"))),
      this.plan.element);
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.start();
    });
    for (const place of [this.fields.element, this.fields.more]) {
      place.addEventListener("input", () => this.forget());
      place.addEventListener("change", ({ target }) => this.fields.check(target));
    }
    byId("panel-start").append(this.jog.element, this.form);
  }

  /** Offer the kinds of job that the supervisor has for rigs of so many arms. */
  offer(arms = 1) {
    this.arms = arms;
    const offered = kindsFor(arms);
    this.kind.replaceChildren(...offered.map(({ name, label }) => h("option", { value: name }, label)));
    this.choose(offered[0].name);
  }

  choose(name) {
    const kind = kindsFor(this.arms).find((each) => each.name === name);
    this.kind.value = name;
    this.fields.show(kind.form, this.defaults[name] ?? {}, this.sources);
    this.jog.element.hidden = !kind.jogs;
    if (kind.jogs) this.jog.show(name);
    this.forget();
    this.follow(this.rig);
  }

  /** Fill the form with the request of a job, and say what of it the form does not have. */
  again(job) {
    if (!kindsFor(this.arms).some((each) => each.name === job.kind)) {
      this.forget();
      this.fault.textContent = `This rig does not accept jobs of kind ${plain(job.kind)}.`;
      return;
    }
    this.choose(job.kind);
    this.fields.fill(job.request);
    // Notes are about one run.
    for (const [name, , input] of this.said) input.value = name === "notes" ? "" : job[name] ?? "";
    this.forget();
    this.kind.focus();
    try {
      const lacking = this.fields.lacking(job.request).filter((name) => !ELSEWHERE.includes(name));
      const words = lacking.map(withoutUnit).join(", ");
      this.filled.textContent = `Filled in from the request of job ${job.id}${words ? `, without: ${words}` : ""}.`;
    } catch (problem) {
      this.tell(problem);
    }
  }

  /** Messages about a request are removed once the request has changed. */
  forget() {
    this.key = freshKey();
    this.fault.textContent = "";
    this.filled.textContent = "";
    this.plan.clear();
    this.fields.forgive();
    this.fields.settle();
    this.name();
  }

  /** Take over what there is: recipes, laws, and defaults from a plan of an empty request. */
  async prefill() {
    try {
      this.sources.recipes = (await get("/recipes")).recipes.map((each) => each.name);
      if (!may("operate")) return;
      const offered = kindsFor(this.rig?.arms ?? this.arms);
      for (const { name, form } of offered.filter((kind) => plannedFields(kind.form).length)) {
        this.defaults[name] = defaultsOf(await planOf({ kind: name }, false), form);
      }
      const used = this.form.contains(document.activeElement) || this.fields.changed().length;
      if (!used) this.choose(this.kind.value);
    } catch (problem) {
      setText(this.fault, told(problem));
    }
  }

  /** Follow the rig: its limits, what it would take, and whether a job would have to wait. */
  follow(rig) {
    if (!rig) return;
    this.rig = rig;
    if (rig.arms !== this.arms) {
      this.offer(rig.arms);
      this.prefill();
    }
    const { startable } = rig;
    const fits = !startable.length || startable.includes(this.kind.value);
    setText(this.hint, fits ? "" : `The rig accepts only ${startable.map(plain).join(" or ")} at the moment.`);
    byId("queue-line").hidden = !(rig.queue.length
      || (rig.active_job && !startable.includes(this.kind.value)));
    this.jog.follow(rig);
    this.name();
  }

  get waits() {
    return !byId("queue-line").hidden && this.queue.checked;
  }

  name() {
    setText(this.button, this.waits ? "Add to the queue" : "Start");
  }

  request() {
    return { kind: this.kind.value, ...this.fields.read(), ...this.description() };
  }

  description() {
    return Object.fromEntries(this.said.map(([name, , input]) => [name, input.value.trim()])
      .filter(([, text]) => text));
  }

  /** Show a problem at the fields that it is about, and the rest below the buttons. */
  tell(problem) {
    const placed = this.fields.tell(problem.faults);
    const rest = placed === 0 || problem.faults.size > placed;
    this.fault.textContent = rest ? told(problem) : problem.title;
  }

  async dryRun() {
    this.forget();
    const { key } = this;
    this.plan.wait();
    try {
      const request = this.request();
      const plan = await planOf(request);
      if (key !== this.key) return;
      this.plan.show(plan, this.rig?.limits ?? [], this.fields.sent(request));
      if (plan.feasible) this.plan.reveal();
      else {
        this.tell({ title: "The plan breaks a limit of the rig", faults: faultsOf(plan.violations),
          message: plan.violations.map((each) => each.message).join("; ") });
      }
    } catch (problem) {
      if (key !== this.key) return;
      this.plan.clear();
      this.tell(problem);
    }
  }

  async start() {
    const { key } = this;
    this.fields.forgive();
    this.fault.textContent = "";
    try {
      const body = this.waits ? { ...this.request(), queue: true } : this.request();
      const job = await (this.fields.fromFile ? startKept(body, this.description(), key)
        : startJob(body, key));
      this.key = freshKey();
      this.plan.clear();
      this.started(job);
    } catch (problem) {
      // Without an answer the key is kept: sent again, the same request makes no second job.
      if (problem.status) this.key = freshKey();
      this.tell(problem);
    }
    this.refresh();
  }
}
