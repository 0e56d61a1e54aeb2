// The course of hours, from the records of the jobs: for each stretch of time the smallest and the
// largest value. It is read as the samples of the last minute are (recent.js).

import { get, RIG_PATH } from "../api.js";
import { plain, toneOfState } from "../words.js";

const EVERY_MS = 15000;
const POINTS = 600;
/** Hues of jobs by how they ended. */
const HUES = { good: 140, busy: 210, warn: 39, bad: 0 };

export class Past {
  constructor() {
    this.hours = 0;
    this.zoom = null;
    this.clock_s = 0;
    this.envelope = true;
    this.clear();
  }

  clear() {
    this.at = [];
    this.low = {};
    this.high = {};
    this.jobs = [];
    this.job = [];
    this.now_s = Date.now() / 1000;
    this.step_s = 1;
    this.left_out = 0;
    this.said = "loading …";
    this.version = (this.version ?? 0) + 1;
  }

  get count() {
    return this.at.length;
  }

  /** Show so many hours, or the two times of `zoom` within them, and go on reading them; with 0 no more. */
  follow(hours, zoom = null) {
    clearTimeout(this.timer);
    if (hours !== this.hours) this.clear();
    Object.assign(this, { hours, zoom });
    if (hours) this.read();
  }

  async read() {
    const { hours, zoom } = this;
    const shown = () => hours === this.hours && zoom === this.zoom;
    const span = zoom ? `hours=${(zoom[1] - zoom[0]) / 3600}&to_s=${zoom[1]}` : `hours=${hours}`;
    try {
      const found = document.hidden ? null : await get(`${RIG_PATH}/history?${span}&points=${POINTS}`);
      if (found && shown()) this.take(found);
    } catch {
      this.said = "the records cannot be read";
      this.version += 1;
    }
    if (shown()) {
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.read(), EVERY_MS);
    }
  }

  take(found) {
    this.at = found.at_s;
    this.low = found.low;
    this.high = found.high;
    this.jobs = found.jobs;
    if (!this.zoom) this.now_s = found.to_s;
    this.step_s = found.step_s;
    this.job = found.at_s.map((at) => found.jobs.findLast(
      (job) => at >= job.from_s - found.step_s && at <= (job.to_s ?? Infinity) + found.step_s));
    this.said = found.jobs.length ? "" : "no job has run in this time";
    if (found.left_out) this.said = `${found.left_out} older jobs are left out`;
    this.version += 1;
  }

  since(at_s) {
    let low = 0;
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.at[middle] < at_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  time(index) {
    return this.at[index];
  }

  /** Between two jobs there is no record. */
  gap(index) {
    return index > 0 && this.at[index] - this.at[index - 1] > 1.5 * this.step_s;
  }

  /** Kind of the job that ran at a point. */
  phase(index) {
    return plain(this.job[index]?.kind);
  }

  /** Which phase a point is in; two jobs of a kind are two. */
  part(index) {
    return this.job[index]?.id;
  }

  hue(index) {
    return HUES[toneOfState(this.job[index]?.state)];
  }

  value(name, index) {
    return (this.bound("low", name, index) + this.bound("high", name, index)) / 2;
  }

  bound(side, name, index) {
    return this[side][name]?.[index] ?? NaN;
  }

  nearest(at_s) {
    const after = this.since(at_s);
    const near = [after - 1, after].filter((index) => index >= 0 && index < this.count
      && Math.abs(this.time(index) - at_s) <= 3600 * this.hours / 100);
    near.sort((a, b) => Math.abs(this.time(a) - at_s) - Math.abs(this.time(b) - at_s));
    return near[0] ?? null;
  }
}
