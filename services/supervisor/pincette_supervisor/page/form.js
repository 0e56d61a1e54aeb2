// Starting a job: fields by kind, a dry run, and the start itself.

import { faultsOf, freshKey, post } from "./api.js";
import { byId, h, setText } from "./dom.js";
import { defaultsOf, KINDS } from "./kinds.js";
import { showPlan } from "./plan.js";
import { unitOf } from "./words.js";

/** One field with its label, its unit, and room for what is wrong with it. */
function control(spec, values) {
  const id = `field-${spec.name}`;
  const common = { id, name: spec.name, "aria-describedby": `${id}-fault` };
  const fault = h("p", { class: "fault", id: `${id}-fault` });
  if (spec.type === "check") {
    return h("div", { class: "field" }, h("label", { class: "check" },
      h("input", { ...common, type: "checkbox" }), h("span", {}, spec.label)), fault);
  }
  const unit = unitOf(spec.name);
  const label = h("label", { for: id }, spec.label, unit ? h("span", { class: "unit" }, unit) : null);
  if (spec.type === "choice") {
    const options = spec.choices.map(([value, text]) => h("option", { value }, text));
    return h("div", { class: "field" }, label, h("select", common, ...options), fault);
  }
  const input = h("input", { ...common, type: "number", inputmode: "decimal", step: spec.step,
    min: spec.min, max: spec.max, required: spec.required, value: values[spec.name] ?? "" });
  if (!spec.required) input.placeholder = spec.empty ?? "as in the rig file";
  return h("div", { class: "field" }, label, input, fault);
}

export class StartForm {
  constructor({ refresh, started }) {
    this.refresh = refresh;
    this.started = started;
    this.key = freshKey();
    this.defaults = {};
    this.limits = {};
    this.build();
    this.choose("grip");
  }

  build() {
    const kinds = Object.entries(KINDS).map(([value, { label }]) => h("option", { value }, label));
    this.kind = h("select", { id: "kind", name: "kind", onchange: () => this.choose(this.kind.value) },
      ...kinds);
    this.fields = h("div", { class: "fields" });
    this.said = h("p", { class: "fault", id: "start-said", role: "alert" });
    this.plan = h("div", { id: "plan", class: "plan", "aria-live": "polite" });
    this.queue = h("input", { type: "checkbox", id: "field-queue" });
    this.form = h("form", { id: "start-form", novalidate: true },
      h("div", { class: "field" }, h("label", { for: "kind" }, "Job"), this.kind),
      this.fields,
      h("label", { class: "check", id: "queue-line", hidden: true }, this.queue,
        h("span", {}, "Wait in the queue until the rig is free")),
      h("div", { class: "buttons" },
        h("button", { type: "submit", class: "main", id: "start" }, "Start"),
        h("button", { type: "button", id: "dry-run", onclick: () => this.dryRun() }, "Dry run")),
      this.said, this.plan);
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.start();
    });
    this.form.addEventListener("input", (event) => this.changed(event.target));
    byId("panel-start").append(this.form);
  }

  choose(kind) {
    this.kind.value = kind;
    this.fields.replaceChildren(...KINDS[kind].fields.map((spec) => control(spec, this.defaults)));
    this.forget();
    this.limit();
  }

  /** What was said about a request holds no longer once the request is another. */
  forget() {
    this.key = freshKey();
    this.said.textContent = "";
    this.plan.replaceChildren();
    for (const each of this.fields.querySelectorAll(".fault")) each.textContent = "";
    for (const each of this.fields.querySelectorAll("[aria-invalid]")) {
      each.removeAttribute("aria-invalid");
    }
  }

  changed(target) {
    this.forget();
    const spec = KINDS[this.kind.value].fields.find((each) => each.name === target.name);
    if (spec?.excludes) byId(`field-${spec.excludes}`).disabled = target.checked;
  }

  /** Take over what the rig file has: defaults from a plan without wishes, limits from the rig. */
  async prefill() {
    try {
      const plan = await planOf({ kind: "grip" }, false);
      this.defaults = defaultsOf(plan);
      if (!this.form.contains(document.activeElement)) this.choose(this.kind.value);
    } catch (problem) {
      setText(this.said, `${problem.title}: ${problem.message}`);
    }
  }

  /** Follow the rig: its limits, and whether a job would have to wait. */
  follow(rig) {
    this.limits = Object.fromEntries(rig.limits.map((each) => [each.quantity, each.value]));
    this.limit();
    byId("queue-line").hidden = !(rig.queue && rig.active_job);
  }

  limit() {
    for (const spec of KINDS[this.kind.value].fields) {
      if (spec.limit && spec.limit in this.limits) {
        byId(`field-${spec.name}`)?.setAttribute("max", this.limits[spec.limit]);
      }
    }
  }

  /** The request as the fields have it. */
  request() {
    const body = { kind: this.kind.value };
    let renamed = {};
    for (const spec of KINDS[body.kind].fields) {
      const input = byId(`field-${spec.name}`);
      if (spec.names) renamed = { ...renamed, [spec.names]: input.value };
      else if (spec.type === "check") {
        if (input.checked) body[spec.name] = true;
      } else if (!input.disabled && input.value !== "") {
        const value = spec.type === "choice" ? input.value : Number(input.value);
        body[renamed[spec.name] ?? spec.name] = value;
      }
    }
    this.renamed = renamed;
    return body;
  }

  /** Tell a problem at the fields that it is about, the rest of it below the buttons. */
  tell(problem) {
    const origin = Object.fromEntries(
      Object.entries(this.renamed ?? {}).map(([name, sent]) => [sent, name]));
    let told = 0;
    for (const [name, text] of problem.faults) {
      const id = `field-${origin[name] ?? name}`;
      const place = byId(`${id}-fault`);
      if (!place) continue;
      place.textContent = text;
      byId(id).setAttribute("aria-invalid", "true");
      told += 1;
      if (told === 1) byId(id).focus();
    }
    const rest = [...problem.faults.values()].length > told || told === 0;
    this.said.textContent = rest ? `${problem.title}: ${problem.message}` : problem.title;
  }

  async dryRun() {
    this.forget();
    this.plan.textContent = "planning …";
    try {
      const plan = await planOf(this.request(), true);
      showPlan(this.plan, plan);
      if (!plan.feasible) {
        this.tell({ title: "The plan breaks a limit of the rig", faults: faultsOf(plan.violations),
          message: plan.violations.map((each) => each.message).join("; ") });
      }
    } catch (problem) {
      this.plan.replaceChildren();
      this.tell(problem);
    }
  }

  async start() {
    const key = this.key;
    for (const each of this.fields.querySelectorAll(".fault")) each.textContent = "";
    this.said.textContent = "";
    const body = { ...this.request(), autostart: true };
    if (!byId("queue-line").hidden && this.queue.checked) body.queue = true;
    try {
      const job = await post("/jobs", body, { "Idempotency-Key": key });
      this.key = freshKey();
      this.plan.replaceChildren();
      this.started(job);
    } catch (problem) {
      // Without an answer the key is kept: sent again, the same request makes no second job.
      if (problem.status) this.key = freshKey();
      this.tell(problem);
    }
    this.refresh();
  }
}

const planOf = (body, predict) => post(`/jobs?dry_run=true&predict=${predict}`, body);
