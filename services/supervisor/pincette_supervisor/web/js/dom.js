// Elements made of text nodes alone: what comes over the wire never becomes markup.

/** An element with attributes, listeners (functions under "onclick" …) and children. */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

export const byId = (id) => document.getElementById(id);

/** Set a text only if it differs, so that a screen reader does not repeat it. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** What a place shows until its content has come. */
export const loading = () => h("p", { class: "muted" }, "loading …");

const shown = new WeakMap();
const waiting = new WeakMap();
const PRESSED_MS = 50;

/** Controls of forms that name their subject (`data-of`), by subject and id. */
const controlsIn = (parent) => new Map([...parent.querySelectorAll("form[data-of] :is(input, textarea)")]
  .map((control) => [`${control.form.dataset.of} ${control.id}`, control]));

/** Keep what a person has typed or ticked in the previous control. */
function keepTyped(control, before) {
  if (before.value !== before.defaultValue) control.value = before.value;
  if (before.checked !== before.defaultChecked) control.checked = before.checked;
}

/** Show children unless they would say the same as before; what had the focus keeps it, and what was
    typed stays. */
export function show(parent, content, make) {
  const key = JSON.stringify(content);
  waiting.delete(parent);
  if (shown.get(parent) === key) return;
  if (parent.matches(":active")) {
    // A button that is replaced between press and release would get no click.
    waiting.set(parent, make);
    setTimeout(() => waiting.get(parent) === make && show(parent, content, make), PRESSED_MS);
    return;
  }
  shown.set(parent, key);
  const focused = parent.contains(document.activeElement) ? document.activeElement : null;
  const { id, selectionStart: from, selectionEnd: to } = focused ?? {};
  const before = controlsIn(parent);
  const open = new Set([...parent.querySelectorAll("details[open]")].map((each) => each.id));
  parent.replaceChildren(...[make()].flat().filter(Boolean));
  for (const details of parent.querySelectorAll("details")) {
    if (open.has(details.id)) details.open = true;
  }
  for (const [name, control] of controlsIn(parent)) {
    if (before.has(name)) keepTyped(control, before.get(name));
  }
  const again = id ? byId(id) : null;
  again?.focus({ preventScroll: true });
  if (again && typeof from === "number") again.setSelectionRange(from, to);
}

/** The names of the columns of a table. */
export const headOf = (names) => h("thead", {}, h("tr", {}, ...names.map((text) => h("th", { scope: "col" }, text))));

/** Note at a list that does not show all entries. */
export const left = (text) => h("p", { class: "muted left" }, text);

/** A word with a mark and a tone, so that colour is never the only sign. */
export function chip(text, tone) {
  const mark = { good: "●", bad: "■", warn: "▲", busy: "▶", muted: "○" }[tone] ?? "";
  const [first, ...more] = String(text).split(/(?=\s)/);
  // The mark stays on the line of the first word.
  return h("span", { class: "chip", "data-tone": tone },
    h("span", { class: "whole" }, h("span", { class: "mark", "aria-hidden": "true" }, mark), first), ...more);
}
