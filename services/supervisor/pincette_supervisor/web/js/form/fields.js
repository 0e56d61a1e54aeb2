// The fields of a form: created from data, read as a request, and marked with their errors.

import { rowsOf, told } from "../api.js";
import { h } from "../dom.js";
import { unitOf } from "../words.js";
import { numberIn, numbersIn, recordsIn } from "./numbers.js";

const WIDE = ["pairs"];
/** Longest label of a choice that half the width of the form has room for. */
const CHOICE_LENGTH = 14;

/** A person states these of the present, so that they are never copied from an earlier request. */
const CONFIRMED = ["zero_confirmed"];

const idOf = (name) => `field-${name}`;

/** The keypad of numbers has no minus sign and no separator on some telephones. */
const keypadOf = ({ widget, minimum }) => (widget === "number" && minimum !== null && minimum >= 0 ? "decimal" : "text");

function input(spec, common, values) {
  const attributes = { ...common, placeholder: spec.required ? null : spec.placeholder };
  if (spec.widget === "text") return h("input", { ...attributes, type: "text" });
  if (spec.widget === "pairs") return h("textarea", { ...attributes, rows: 4 });
  // A text field: a browser drops from a number field what it cannot read, and the wheel changes it.
  const made = h("input", { ...attributes, type: "text", inputmode: keypadOf(spec),
    "aria-required": spec.required ? "true" : null, autocomplete: "off", spellcheck: "false" });
  made.defaultValue = String(values[spec.name] ?? "");
  return made;
}

/** A file whose rows replace the content of a field of points. */
function file(spec) {
  const load = async ({ target }) => {
    const points = target.closest(".field").querySelector("textarea");
    try {
      points.value = textOf(await rowsOf(target.files[0], spec.columns), spec);
      points.dispatchEvent(new Event("input", { bubbles: true }));
    } catch (problem) {
      mark(points, told(problem));
      target.value = "";
    }
  };
  return h("input", { type: "file", id: `${idOf(spec.name)}-file`, accept: ".csv,.tsv,.txt,.parquet",
    "aria-label": `File with ${spec.columns.join(" and ")}`, onchange: load });
}

/** One field with its label, its unit, and room for what is wrong with it. */
function control(spec, values, sources) {
  const id = idOf(spec.name);
  const common = { id, name: spec.name, "aria-describedby": `${id}-fault ${id}-read` };
  const fault = h("p", { class: "fault", id: `${id}-fault` });
  const read = h("output", { class: "read", id: `${id}-read`, for: id });
  if (spec.widget === "check") {
    return h("div", { class: "field wide" }, h("label", { class: "check" },
      h("input", { ...common, type: "checkbox", checked: spec.ticked }), h("span", {}, spec.label)), fault);
  }
  const unit = h("span", { class: "unit", id: `${id}-unit` }, spec.unit);
  const label = h("label", { for: id, title: spec.meaning || null }, spec.label, unit);
  const style = `field${WIDE.includes(spec.widget) ? " wide" : ""}`;
  if (!["choice", "recipe"].includes(spec.widget)) {
    return h("div", { class: style }, label, input(spec, common, values), read,
      spec.widget === "pairs" ? file(spec) : null, fault);
  }
  const choices = spec.widget === "choice" ? spec.choices
    : [{ value: "", label: spec.placeholder }, ...sources.recipes.map((name) => ({ value: name, label: name }))];
  const long = choices.some((each) => each.label.length > CHOICE_LENGTH);
  return h("div", { class: long ? "field wide" : style }, label,
    h("select", common, ...choices.map((each) => h("option", { value: each.value }, each.label))), fault);
}

/** Readers of typed text; each throws an Error that states a valid form. */
const READ = {
  number: (text, { whole }) => numberIn(text, { whole }),
  choice: (text) => text,
  recipe: (text) => text,
  text: (text) => text,
  list: numbersIn,
  words: (text) => text.split(/[\s;,]+/).filter(Boolean),
  pairs: (text, { columns }) => recordsIn(text, columns),
};

/** What a text was understood as; empty where it is spelled in the same way. */
function understood(spec, text, unit) {
  if (!["number", "list", "pairs"].includes(spec.widget) || text.trim() === "") return "";
  try {
    const value = READ[spec.widget](text, spec);
    const words = inWords(value);
    return words === text.trim() ? "" : `= ${words} ${unit}`.trim();
  } catch {
    return "";
  }
}

/** A value of a request as a person reads it. */
export function inWords(value) {
  if (Array.isArray(value)) return value.map(inWords).join("; ");
  if (value && typeof value === "object") return Object.values(value).map(inWords).join(" ");
  if (typeof value === "boolean") return value ? "yes" : "no";
  return String(value);
}

/** The text of a field that is read as a value. */
function textOf(value, { widget, columns }) {
  if (widget !== "pairs" || !Array.isArray(value)) return inWords(value);
  return value.map((record) => columns.map((name) => record[name]).join(" ")).join("\n");
}

/** Whether a second value states everything that the first one does. */
function covers(value, other) {
  if (value === null || value === undefined) return true;
  if (typeof value !== "object") return value === other;
  return Object.keys(value).every((name) => covers(value[name], other?.[name]));
}

/** Show at a field what is wrong with it. */
function mark(found, text) {
  found.closest(".field").querySelector(".fault").textContent = text;
  found.setAttribute("aria-invalid", "true");
}

/** Fields whose texts cannot be read, by the members that they would be sent as. */
class FieldsError extends Error {
  constructor(faults) {
    super([...faults].map(([name, text]) => `${name}: ${text}`).join("; "));
    this.title = "Not sent: a number cannot be read";
    this.faults = faults;
  }
}

export class Fields {
  constructor() {
    this.specs = [];
    this.element = h("div", { class: "fields" });
    this.further = h("div", { class: "fields" });
    this.more = h("details", { id: "more-fields" }, h("summary", {}, "More"), this.further);
  }

  show(form, values, sources) {
    const changed = form === this.form ? this.changed() : [];
    const make = (spec) => control(spec, values, sources);
    this.form = form;
    this.specs = form.filter((spec) => spec.widget !== "recipe" || sources.recipes.length);
    const more = this.specs.filter((spec) => spec.advanced);
    this.element.replaceChildren(...this.specs.filter((spec) => !spec.advanced).map(make));
    this.further.replaceChildren(...more.map(make));
    this.more.hidden = more.length === 0;
    for (const [name, property, value] of changed) this.find(name)[property] = value;
    this.settle();
  }

  /** What a person has typed, chosen or ticked: the field's name, and a property with its value. */
  changed() {
    return this.specs.flatMap(({ name, ticked }) => {
      const found = this.find(name);
      const [property, before] = found.type === "checkbox" ? ["checked", ticked]
        : ["value", found.defaultValue ?? found.options[0]?.value];
      return found[property] === before ? [] : [[name, property, found[property]]];
    });
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
      const unit = spec.named_by ? unitOf(this.sentAs(spec)) : spec.unit;
      if (spec.named_by) found.closest(".field").querySelector(".unit").textContent = unit;
      const read = found.closest(".field").querySelector(".read");
      if (read) read.textContent = understood(spec, found.value, unit);
    }
  }

  /** Whether points came from a file. */
  get fromFile() {
    return this.specs.some(({ name, widget }) => widget === "pairs" && !this.find(name).closest(".field").hidden
      && this.find(`${name}-file`).value);
  }

  sentAs(spec) {
    return spec.named_by ? this.find(spec.named_by).value : spec.sent_as || spec.name;
  }

  /** The members of a request that the fields have; throws a FieldsError for what cannot be read. */
  read() {
    const body = {};
    const faults = new Map();
    for (const spec of this.specs) {
      const found = this.find(spec.name);
      if (spec.names || found.disabled || found.closest(".field").hidden) continue;
      if (spec.widget === "check") {
        if (found.checked !== spec.ticked) body[spec.name] = found.checked;
      } else if (found.value.trim() !== "" || spec.required) {
        const place = spec.within ? body[spec.within] ??= {} : body;
        try {
          place[this.sentAs(spec)] = READ[spec.widget](found.value, spec);
        } catch (error) {
          faults.set(this.sentAs(spec), error.message);
        }
      }
    }
    if (faults.size) throw new FieldsError(faults);
    return body;
  }

  /** Label and value with its unit of everything that a request states. */
  sent(request) {
    const shown = [];
    for (const spec of this.specs) {
      const name = this.sentAs(spec);
      const place = spec.within ? request[spec.within] : request;
      if (spec.names || place?.[name] === undefined) continue;
      const unit = spec.named_by ? unitOf(name) : spec.unit;
      shown.push([spec.label, `${inWords(place[name])} ${unit}`.trim()]);
    }
    return shown;
  }

  set(values) {
    for (const [name, value] of Object.entries(values)) this.find(name).value = value;
    this.settle();
  }

  /** Fill every field with what a request states, and empty those that it leaves out. */
  fill(request) {
    const naming = this.specs.filter((spec) => spec.names);
    for (const { name, choices } of naming) {
      const chosen = choices.find(({ value }) => typeof request[value] === "number");
      if (chosen) this.find(name).value = chosen.value;
    }
    for (const spec of this.specs) {
      if (naming.includes(spec)) continue;
      const found = this.find(spec.name);
      const value = (spec.within ? request[spec.within] : request)?.[this.sentAs(spec)] ?? null;
      if (spec.widget === "check") {
        found.checked = CONFIRMED.includes(spec.name) ? spec.ticked : value ?? spec.ticked;
      } else found.value = value === null ? "" : textOf(value, spec);
      if (found.selectedIndex === -1) found.selectedIndex = 0;
      if (spec.advanced && value !== null) this.more.open = true;
    }
    this.settle();
  }

  /** Return the members of a request that the fields do not state as they are. */
  lacking(request) {
    const sent = this.read();
    for (const spec of this.specs) {
      if (spec.widget === "check") sent[spec.name] ??= spec.ticked;
    }
    return Object.keys(request).filter((name) => !covers(request[name], sent[name]));
  }

  /** Refuse a text that cannot be read as soon as its field is left. */
  check(found) {
    const spec = this.specs.find(({ name }) => name === found.name);
    if (!spec || found.value.trim() === "" || spec.widget === "check") return;
    try {
      READ[spec.widget](found.value, spec);
    } catch (error) {
      mark(found, error.message);
    }
  }

  forgive() {
    for (const place of [this.element, this.further]) {
      for (const each of place.querySelectorAll(".fault")) each.textContent = "";
      for (const each of place.querySelectorAll("[aria-invalid]")) each.removeAttribute("aria-invalid");
    }
  }

  /** Show texts at the fields that they are about; return how many had a field. */
  tell(faults) {
    let told = 0;
    for (const spec of this.specs) {
      const found = this.find(spec.name);
      const text = faults.get(this.sentAs(spec));
      if (!text || found.closest(".field").hidden) continue;
      mark(found, text);
      if (this.further.contains(found)) this.more.open = true;
      told += 1;
      if (told === 1) found.focus();
    }
    return told;
  }
}
