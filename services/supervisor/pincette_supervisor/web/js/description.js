// The description of a job: shown with it, and edited at any time.

import { patch, told } from "./api.js";
import { byId, h } from "./dom.js";

const SHORT = 14;
export const SAID = [["sample", "Sample"], ["batch", "Batch"], ["operator", "Operator"], ["notes", "Notes"]];

/** Sample and batch, then labels. */
const partsOf = (job) => [job.sample, job.batch,
  ...Object.entries(job.labels).map(([name, text]) => `${name}=${text}`)].filter(Boolean);

/** The same in one line. */
export const saidOf = (job) => partsOf(job).join(" · ");

/** The same for a narrow column, in which what is short keeps its line. */
export const saidIn = (job) => partsOf(job).flatMap((text, place) => [place ? " · " : "",
  h("span", { class: text.length <= SHORT ? "whole" : "" }, text)]);

/** Label and text of each field of the description that is not empty. */
export const factsOf = (job) => [...SAID.map(([name, label]) => [label, job[name]]),
  ...Object.entries(job.labels)].filter(([, text]) => text);

/** A row for a text of a job; notes have room for lines. */
export function field(id, label, value = "", more = {}) {
  const input = label === "Notes" ? h("textarea", { id, rows: "3", ...more })
    : h("input", { type: "text", id, autocomplete: "off", ...more });
  input.defaultValue = value;
  return [h("div", { class: "field" }, h("label", { for: id }, label), input), input];
}

/** A form for the description of a job; `changed` receives the edited job. */
export function describe(job, changed) {
  const rows = SAID.map(([name, label]) => [name, ...field(`said-${name}`, label, job[name])]);
  const labels = Object.entries(job.labels).map(([name, text]) => `${name}=${text}`).join("\n");
  const list = h("textarea", { id: "said-labels", rows: "2", placeholder: "name=text, one per line" });
  list.defaultValue = labels;
  const pin = h("input", { type: "checkbox", id: "said-pinned" });
  pin.defaultChecked = job.pinned;
  const fault = h("p", { class: "fault", id: "said-fault", role: "alert" });
  const save = async (event) => {
    event.preventDefault();
    fault.textContent = "";
    try {
      const body = Object.fromEntries(rows.map(([name, , input]) => [name, input.value.trim()]));
      const saved = await patch(`/jobs/${job.id}`, { ...body, labels: labelsIn(list.value), pinned: pin.checked });
      event.target.reset();
      changed(saved);
      byId("job-title")?.focus();
    } catch (problem) {
      fault.textContent = told(problem);
    }
  };
  return h("details", { id: "job-said" }, h("summary", {}, "Describe"),
    h("form", { id: "said-form", "data-of": job.id, onsubmit: save }, ...rows.map(([, row]) => row),
      h("div", { class: "field" }, h("label", { for: "said-labels" }, "Labels"), list),
      h("label", { class: "check" }, pin, h("span", {}, "Keep the record, whatever its age")),
      h("div", { class: "buttons" }, h("button", { type: "submit", "data-needs": "operate" }, "Save")), fault));
}

function labelsIn(text) {
  const pairs = text.split("\n").map((line) => line.trim()).filter(Boolean).map((line) => {
    const place = line.indexOf("=");
    if (place < 1) throw new Error(`${line} is not a label: write name=text`);
    return [line.slice(0, place), line.slice(place + 1)];
  });
  return Object.fromEntries(pairs);
}
