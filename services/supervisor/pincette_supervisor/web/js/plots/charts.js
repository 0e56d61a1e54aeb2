// The charts: one strip a quantity, all over the same time, with a common crosshair. They draw the
// last minute of live samples, or hours of the records.

import { byId, setText } from "../dom.js";
import { clock, duration } from "../words.js";
import { palette } from "./axes.js";
import { QUANTITIES, Readout, Strip } from "./strip.js";

const OLD_S = 3;
const FRAME_MS = 60;

/** All strips, what they show, and the newest values as a table. */
export class Charts {
  constructor(recent, past) {
    this.recent = recent;
    this.past = past;
    this.view = { seconds: 30, from: -30, to: 0, cross: null, held: null,
      zoom: null, picked: null, shows: "values", expert: false };
    this.arms = 1;
    this.strips = QUANTITIES.map((each) => new Strip(each));
    this.readouts = QUANTITIES.map((each) => new Readout(each));
    byId("charts").append(...this.strips.map((strip) => strip.element));
    byId("readouts").append(...this.readouts.map((readout) => readout.element));
    this.choose({});
    this.colours = palette();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.colours = palette();
      this.dirty = true;
    });
    new ResizeObserver(() => { this.dirty = true; }).observe(byId("charts"));
    this.drawn = "";
    this.drawnAt = 0;
    requestAnimationFrame((now) => this.frame(now));
  }

  /** The samples that are drawn. */
  get source() {
    return this.past.hours ? this.past : this.recent;
  }

  /** Show values or errors, with or without what only experts read, over some seconds or hours. */
  choose(change) {
    const { view } = this;
    Object.assign(view, change);
    if (change.seconds) Object.assign(view, { cross: null, held: null, zoom: null });
    if (change.seconds || change.zoom !== undefined) {
      this.past.follow(view.seconds >= 3600 ? view.seconds / 3600 : 0, view.zoom);
    }
    const most = this.past.hours ? 1 : this.arms;
    const both = most > 1;
    const listed = this.strips.filter(({ quantity }) => (quantity.arms ?? 1) <= most
      && (quantity.expert ? view.expert : !quantity.shows || quantity.shows === view.shows));
    const seen = listed.filter(({ quantity }) => !quantity.drawnIn);
    for (const [place, strip] of this.strips.entries()) {
      strip.element.hidden = !seen.includes(strip);
      this.readouts[place].element.hidden = !listed.includes(strip);
      strip.settle({ first: strip === seen[0], last: strip === seen.at(-1), both });
      this.readouts[place].settle({ both });
    }
    this.dirty = true;
  }

  /** The limits of the rig, and the tolerances of the job that runs or has run last. */
  follow(rig, job) {
    if (this.arms !== (rig.arms ?? 1)) {
      this.arms = rig.arms;
      this.choose({});
    }
    for (const [place, strip] of this.strips.entries()) {
      strip.limits = rig.limits.filter((each) => strip.quantity.limits.includes(each.quantity))
        .map((each) => each.value);
      strip.tolerance = job?.values?.[strip.quantity.tolerance] ?? null;
      this.readouts[place].tolerance = strip.tolerance;
    }
    this.dirty = true;
  }

  /** Draw where something has changed, and not too often. */
  frame(now) {
    const state = `${this.past.hours} ${this.source.version}`;
    const changed = this.dirty || this.drawn !== state || this.told !== this.recent.version;
    if (changed && now - this.drawnAt >= FRAME_MS && !document.hidden) {
      const still = !this.dirty && this.drawn === state;
      this.drawn = state;
      this.told = this.recent.version;
      this.drawnAt = now;
      this.dirty = false;
      if (still) this.tell();
      else this.draw();
    }
    requestAnimationFrame((later) => this.frame(later));
  }

  draw() {
    const { source, view } = this;
    if (!view.picked) { // charts do not move below a pointer that chooses a stretch of them
      const to = view.held ?? source.now_s ?? 0;
      [view.from, view.to] = view.zoom ?? [to - view.seconds, to];
    }
    if (view.cross !== null && (view.cross < view.from || view.cross > view.to)) view.cross = null;
    for (const strip of this.strips) if (!strip.element.hidden) strip.draw(source, view, this.colours);
    this.tell();
  }

  /** The newest values in the table; those under the crosshair beside each strip. */
  tell() {
    const { recent, source, view } = this;
    const under = view.cross === null ? null : source.nearest(view.cross);
    for (const [place, strip] of this.strips.entries()) {
      this.readouts[place].show(recent);
      setText(strip.said, under === null ? "" : strip.words(source, under));
    }
    setText(byId("at"), under === null ? "" : this.under(under));
    setText(byId("age"), under === null ? this.silence() : "");
  }

  /** Clock time of a sample, and the phase or the job at that time. */
  under(index) {
    const { source } = this;
    const at = clock(new Date(1000 * (source.time(index) + source.clock_s)).toISOString());
    return [at, source.phase(index)].filter(Boolean).join(" · ");
  }

  /** Reason why the charts are not updated, or are empty; empty while samples arrive. */
  silence() {
    const { source } = this;
    if (source.envelope) return source.said;
    if (!source.count) return source.now_s === null ? "loading …" : "no samples yet";
    const age_s = source.now_s - source.time(source.count - 1);
    return age_s > OLD_S ? `newest sample ${duration(Math.floor(age_s))} ago` : "";
  }
}
