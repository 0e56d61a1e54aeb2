// The fields of a form: made of data, read as a request, told what is wrong with them.

import { h } from "../dom.js";
import { unitOf } from "../words.js";

const WIDE = ["pairs"];

const idOf = (name) => `field-${name}`;

function input(spec, common, values) {
  const attributes = { ...common, placeholder: spec.required ? null : spec.placeholder };
  if (spec.widget === "list") return h("input", { ...attributes, type: "text", inputmode: "decimal" });
  if (spec.widget === "text") return h("input", { ...attributes, type: "text" });
  if (spec.widget === "pairs") return h("textarea", { ...attributes, rows: 4 });
  return h("input", { ...attributes, type: "number", inputmode: "decimal", step: spec.whole ? 1 : "any",
    min: spec.minimum, max: spec.maximum, required: spec.required, value: values[spec.name] ?? "" });
}

/** One field with its label, its unit, and room for what is wrong with it. */
function control(spec, values, sources) {
  const id = idOf(spec.name);
  const common = { id, name: spec.name, "aria-describedby": `${id}-fault` };
  const fault = h("p", { class: "fault", id: `${id}-fault` });
  if (spec.widget === "check") {
    return h("div", { class: "field wide" }, h("label", { class: "check" },
      h("input", { ...common, type: "checkbox", checked: spec.ticked }), h("span", {}, spec.label)), fault);
  }
  const unit = h("span", { class: "unit", id: `${id}-unit` }, spec.unit);
  const label = h("label", { for: id, title: spec.meaning || null }, spec.label, unit);
  const style = `field${WIDE.includes(spec.widget) ? " wide" : ""}`;
  if (!["choice", "recipe"].includes(spec.widget)) {
    return h("div", { class: style }, label, input(spec, common, values), fault);
  }
  const choices = spec.widget === "choice" ? spec.choices
    : [{ value: "", label: spec.placeholder }, ...sources.recipes.map((name) => ({ value: name, label: name }))];
  return h("div", { class: style }, label,
    h("select", common, ...choices.map((each) => h("option", { value: each.value }, each.label))), fault);
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
  recipe: (text) => text,
  text: (text) => text,
  list: numbers,
  pairs: (text, { columns }) => text.trim().split("\n").map((line) => {
    const values = numbers(line);
    return Object.fromEntries(values.map((value, place) => [columns[place] ?? `${place + 1}`, value]));
  }),
};

export class Fields {
  constructor() {
    this.specs = [];
    this.element = h("div", { class: "fields" });
    this.further = h("div", { class: "fields" });
    this.more = h("details", { id: "more-fields" }, h("summary", {}, "More"), this.further);
  }

  show(form, values, sources) {
    const make = (spec) => control(spec, values, sources);
    this.specs = form.filter((spec) => spec.widget !== "recipe" || sources.recipes.length);
    const more = this.specs.filter((spec) => spec.advanced);
    this.element.replaceChildren(...this.specs.filter((spec) => !spec.advanced).map(make));
    this.further.replaceChildren(...more.map(make));
    this.more.hidden = more.length === 0;
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
      if (spec.named_by) {
        found.closest(".field").querySelector(".unit").textContent = unitOf(this.sentAs(spec));
      }
    }
  }

  sentAs(spec) {
    return spec.named_by ? this.find(spec.named_by).value : spec.sent_as || spec.name;
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
      if (spec.widget === "check") {
        if (found.checked !== spec.ticked) body[spec.name] = found.checked;
      } else if (found.value.trim() !== "") {
        const place = spec.within ? body[spec.within] ??= {} : body;
        place[this.sentAs(spec)] = READ[spec.widget](found.value, spec);
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
