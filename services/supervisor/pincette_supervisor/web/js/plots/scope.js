// What a person does to the charts: how much they show, the crosshair, and holding the view.

import { byId } from "../dom.js";

const STEP_SHARE = 1 / 60;

export function install(charts) {
  const { view } = charts;
  const again = () => { charts.dirty = true; };

  const freeze = byId("freeze");
  const follow = () => {
    freeze.setAttribute("aria-pressed", String(view.held !== null));
    freeze.textContent = view.held === null ? "Hold view" : "Follow again";
    again();
  };
  choice("window", (button) => {
    charts.choose({ seconds: Number(button.dataset.seconds) });
    byId("scope-title").textContent = view.seconds < 3600 ? "Live" : "Records";
    freeze.hidden = view.seconds >= 3600;
    follow();
  });
  choice("shows", (button) => charts.choose({ shows: button.dataset.shows }));
  byId("expert").addEventListener("click", (event) => {
    charts.choose({ expert: !view.expert });
    event.target.setAttribute("aria-pressed", String(view.expert));
  });
  freeze.addEventListener("click", () => {
    view.held = view.held === null ? charts.recent.now_s : null;
    follow();
  });

  const place = byId("charts");
  const point = (event) => {
    const canvas = event.target.closest("canvas");
    const axes = charts.strips.find((strip) => strip.canvas === canvas)?.axes;
    if (!charts.source.count || !axes?.box) return;
    view.cross = axes.timeAt(event.clientX - canvas.getBoundingClientRect().left);
    again();
  };
  place.addEventListener("pointermove", point);
  place.addEventListener("pointerdown", point);
  place.addEventListener("pointerleave", (event) => {
    if (event.pointerType !== "mouse") return;
    view.cross = null;
    again();
  });
  place.addEventListener("keydown", (event) => {
    const step = view.seconds * STEP_SHARE * (event.shiftKey ? 5 : 1);
    const cross = view.cross ?? view.to;
    if (event.key === "ArrowLeft") view.cross = Math.max(view.from, cross - step);
    else if (event.key === "ArrowRight") view.cross = Math.min(view.to, cross + step);
    else if (event.key === "Home") view.cross = null;
    else return;
    event.preventDefault();
    again();
  });
}

/** Buttons of which one is chosen. */
function choice(id, chosen) {
  byId(id).addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (!button) return;
    for (const each of byId(id).querySelectorAll("button")) {
      each.setAttribute("aria-pressed", String(each === button));
    }
    chosen(button);
  });
}
