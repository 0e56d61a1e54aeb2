// What a person does to the charts: how much they show, the crosshair, and holding the view.

import { byId } from "../dom.js";

const STEP_SHARE = 1 / 60;

export function install(charts) {
  const { view } = charts;
  const again = () => { charts.dirty = true; };

  byId("window").addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (!button) return;
    view.seconds = Number(button.dataset.seconds);
    for (const each of byId("window").querySelectorAll("button")) {
      each.setAttribute("aria-pressed", String(each === button));
    }
    again();
  });

  byId("freeze").addEventListener("click", (event) => {
    view.held = view.held === null ? charts.recent.now_s : null;
    event.target.setAttribute("aria-pressed", String(view.held !== null));
    event.target.textContent = view.held === null ? "Hold view" : "Follow again";
    again();
  });

  const place = byId("charts");
  const point = (event) => {
    const canvas = event.target.closest("canvas");
    if (!canvas || !charts.recent.count || !charts.strips[0].axes.box) return;
    const x = event.clientX - canvas.getBoundingClientRect().left;
    view.cross = charts.strips[0].axes.timeAt(x);
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
    else if (event.key === "Home" || event.key === "Escape") view.cross = null;
    else return;
    if (event.key !== "Escape") event.preventDefault();
    again();
  });
}
