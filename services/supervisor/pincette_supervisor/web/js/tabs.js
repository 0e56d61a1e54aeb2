// Tabs as screen readers and keyboards expect them: arrow keys move, one panel is seen.

import { byId } from "./dom.js";

export function installTabs(opened) {
  const tabs = [...byId("tabs").querySelectorAll("[role=tab]")];

  function choose(tab, focus = false) {
    for (const each of tabs) {
      const chosen = each === tab;
      each.setAttribute("aria-selected", String(chosen));
      each.tabIndex = chosen ? 0 : -1;
      byId(each.getAttribute("aria-controls")).hidden = !chosen;
    }
    if (focus) tab.focus();
    opened(tab.id);
  }

  byId("tabs").addEventListener("click", (event) => {
    const tab = event.target.closest("[role=tab]");
    if (tab) choose(tab);
  });
  byId("tabs").addEventListener("keydown", (event) => {
    const place = tabs.indexOf(document.activeElement);
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (step === undefined || place < 0) return;
    event.preventDefault();
    choose(tabs[(place + step + tabs.length) % tabs.length], true);
  });
  return (id) => choose(byId(id));
}
