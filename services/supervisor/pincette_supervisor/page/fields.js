// The fields of a form: made of data, read as a request, told what is wrong with them.

import { h } from "./dom.js";
import { unitOf } from "./words.js";

const idOf = (name) => `field-${name}`;

function input(spec, common, values) {
  const attributes = { ...common, placeholder: spec.required ? null : spec.empty ?? "as in the rig file" };
  if (spec.type === "list") return h("input", { ...attributes, type: "text", inputmode: "decimal" });
  if (spec.type === "pairs") return h("textarea", { ...attributes, rows: 4 });
  return h("input", { ...attributes, type: "number", inputmode: "decimal", step: spec.step,
    min: spec.min, max: spec.max, required: spec.required, value: values[spec.name] ?? "" });
}

/** One field with its label, its unit, and room for what is wrong with it. */
function control(spec, values, sources) {
  const id = idOf(spec.name);
  const common = { id, name: spec.name, "aria-describedby": `${id}-fault` };
  const fault = h("p", { class: "fault", id: `${id}-fault` });
  if (spec.type === "check") {
    return h("div", { class: "field wide" }, h("label", { class: "check" },
      h("input", { ...common, type: "checkbox" }), h("span", {}, spec.label)), fault);
  }
  const unit = h("span", { class: "unit", id: `${id}-unit` }, spec.type === "pairs" ? "" : unitOf(spec.name));
  const label = h("label", { for: id }, spec.label, unit);
  const kind = `field${spec.type === "pairs" ? " wide" : ""}`;
  if (spec.type !== "choice") return h("div", { class: kind }, label, input(spec, common, values), fault);
  const choices = spec.choices ?? [["", "none"], ...sources[spec.source].map((name) => [name, name])];
  return h("div", { class: kind }, label,
    h("select", common, ...choices.map(([value, text]) => h("option", { value }, text))), fault);
}

/** Numbers of a text, however they are parted; what is no number stays for the server to name. */
function numbers(text) {
  return text.split(/[\s,;]+/).filter(Boolean).map((word) => {
    const value = Number(word);
    return Number.isFinite(value) ? value : word;
  });
}

const READ = {
  number: (text) => Number(text),
  choice: (text) => text,
  list: numbers,
  pairs: (text, { pair }) => text.trim().split("\n").map((line) => {
    const values = numbers(line);
    return Object.fromEntries(values.map((value, place) => [pair[place] ?? `${place + 1}`, value]));
  }),
};

export class Fields {
  constructor() {
    this.specs = [];
    this.element = h("div", { class: "fields" });
    this.further = h("div", { class: "fields" });
    this.more = h("details", { id: "more-fields" }, h("summary", {}, "More"), this.further);
  }

  show({ fields, more = [] }, values, sources) {
    const offered = (spec) => !spec.source || sources[spec.source]?.length;
    const make = (spec) => control(spec, values, sources);
    this.element.replaceChildren(...fields.filter(offered).map(make));
    this.further.replaceChildren(...more.filter(offered).map(make));
    this.more.hidden = more.length === 0;
    this.specs = [...fields, ...more].filter(offered);
    this.settle();
  }

  find(name) {
    return this.element.querySelector(`#${idOf(name)}`) ?? this.further.querySelector(`#${idOf(name)}`);
  }

  /** Show the fields that belong to what is chosen, and switch off those that are excluded. */
  settle() {
    for (const spec of this.specs) {
      const found = this.find(spec.name);
      const fits = Object.entries(spec.when ?? {}).every(
        ([name, choices]) => choices.includes(this.find(name)?.value));
      found.closest(".field").hidden = !fits;
      if (spec.excludes) this.find(spec.excludes).disabled = found.checked;
      if (spec.namedBy) {
        found.closest(".field").querySelector(".unit").textContent = unitOf(this.sentAs(spec));
      }
    }
  }

  sentAs(spec) {
    return spec.namedBy ? this.find(spec.namedBy).value : spec.name;
  }

  limit(limits) {
    for (const spec of this.specs) {
      if (spec.limit in limits) this.find(spec.name).setAttribute("max", limits[spec.limit]);
    }
  }

  /** The members of a request that the fields have. */
  read() {
    const body = {};
    for (const spec of this.specs) {
      const found = this.find(spec.name);
      if (spec.names || found.disabled || found.closest(".field").hidden) continue;
      if (spec.type === "check") {
        if (found.checked) body[spec.name] = true;
      } else if (found.value.trim() !== "") {
        body[this.sentAs(spec)] = READ[spec.type](found.value, spec);
      }
    }
    return body;
  }

  set(values) {
    for (const [name, value] of Object.entries(values)) this.find(name).value = value;
    this.settle();
  }

  forgive() {
    for (const place of [this.element, this.further]) {
      for (const each of place.querySelectorAll(".fault")) each.textContent = "";
      for (const each of place.querySelectorAll("[aria-invalid]")) each.removeAttribute("aria-invalid");
    }
  }

  /** Tell texts at the fields that they are about; how many had a place. */
  tell(faults) {
    let told = 0;
    for (const spec of this.specs) {
      const found = this.find(spec.name);
      const text = faults.get(this.sentAs(spec));
      if (!text || found.closest(".field").hidden) continue;
      found.closest(".field").querySelector(".fault").textContent = text;
      found.setAttribute("aria-invalid", "true");
      if (this.further.contains(found)) this.more.open = true;
      told += 1;
      if (told === 1) found.focus();
    }
    return told;
  }
}
