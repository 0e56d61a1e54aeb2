// What a person does to the charts: how much they show, the crosshair, holding the view, and zooming.

import { byId } from "../dom.js";
import { onDrag } from "./drag.js";

const STEP_SHARE = 1 / 60;
const LEAST_S = { live: 0.2, hours: 20 };

export function install(charts) {
  const { view } = charts;
  const again = () => { charts.dirty = true; };

  const freeze = byId("freeze");
  const whole = byId("zoom-out");
  const settle = () => {
    whole.hidden = !view.zoom;
    freeze.hidden = Boolean(view.zoom) || view.seconds >= 3600;
    freeze.setAttribute("aria-pressed", String(view.held !== null));
    freeze.textContent = view.held === null ? "Hold view" : "Follow again";
    again();
  };
  const zoom = (range) => {
    charts.choose({ zoom: range });
    settle();
  };
  const zoomTo = ([from, to]) => {
    const middle = (from + to) / 2;
    const half = Math.max(to - from, view.seconds < 3600 ? LEAST_S.live : LEAST_S.hours) / 2;
    zoom([middle - half, middle + half]);
  };
  choice("window", (button) => {
    charts.choose({ seconds: Number(button.dataset.seconds) });
    byId("scope-title").textContent = view.seconds < 3600 ? "Live" : "Records";
    settle();
  });
  choice("shows", (button) => charts.choose({ shows: button.dataset.shows }));
  byId("expert").addEventListener("click", (event) => {
    charts.choose({ expert: !view.expert });
    event.target.setAttribute("aria-pressed", String(view.expert));
  });
  freeze.addEventListener("click", () => {
    view.held = view.held === null ? charts.recent.now_s : null;
    settle();
  });

  const place = byId("charts");
  const axesOf = (canvas) => charts.strips.find((strip) => strip.canvas === canvas)?.axes;
  onDrag(place, axesOf, { chosen: zoomTo, picking: (picked) => {
    view.picked = picked;
    again();
  } });
  whole.addEventListener("click", () => zoom(null));
  place.addEventListener("dblclick", () => zoom(null));
  const point = (event) => {
    const canvas = event.target.closest("canvas");
    const axes = axesOf(canvas);
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
    const span = view.to - view.from;
    const step = span * STEP_SHARE * (event.shiftKey ? 5 : 1);
    const cross = view.cross ?? view.to;
    if (event.key === "ArrowLeft") view.cross = Math.max(view.from, cross - step);
    else if (event.key === "ArrowRight") view.cross = Math.min(view.to, cross + step);
    else if (event.key === "Home") view.cross = null;
    else if (event.key === "+") zoomTo([cross - span / 4, cross + span / 4]);
    else if (event.key === "-") zoom(null);
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
