// The samples of the last minute, in columns; the oldest make room for the newest.

import { now_s } from "../words.js";

export const COLUMNS = ["x_um", "x_r_um", "force_mN", "force_r_mN", "force_uncertainty_mN",
  "voltage_V", "sliding_um"];
/** Of a rig of two arms: what a batch has in `second`, and what it is called here. */
const OF_SECOND = { second_x_um: "x_um", second_force_mN: "force_mN", second_voltage_V: "voltage_V",
  place_um: "place_um", place_r_um: "place_r_um" };
const CAPACITY = 8192;
/** Hues of the phases, as in the figure of a job. */
const HUES = { open: 210, approach: 210, move: 210, retreat: 210, condition: 39, contact: 39, load: 28, unload: 28,
  hold: 140, track: 140, stopping: 0, stopped: 0 };
/** What is worked out of two columns: measured or estimated, less its reference. */
const ERRORS = { x_error_um: ["x_um", "x_r_um"], force_error_mN: ["force_mN", "force_r_mN"],
  place_error_um: ["place_um", "place_r_um"], apart_mN: ["force_mN", "second_force_mN"] };

export class Recent {
  constructor() {
    this.columns = new Map([...COLUMNS, ...Object.keys(OF_SECOND)].map((name) => [name, new Float64Array(CAPACITY)]));
    this.at = new Float64Array(CAPACITY);
    this.phases = new Array(CAPACITY).fill("");
    this.gaps = new Uint8Array(CAPACITY);
    this.clear();
  }

  clear() {
    this.count = 0;
    this.dropped = 0;
    this.now_s = null;
    /** Seconds since 1970 at the time 0 of the samples. */
    this.clock_s = null;
    this.version = (this.version ?? 0) + 1;
  }

  /** Take a batch; what is not newer than what there is has come twice. */
  push(batch) {
    let newest = this.count ? this.at[(this.count - 1) % CAPACITY] : -Infinity;
    for (let i = 0; i < batch.seq.length; i += 1) {
      if (batch.at_s[i] <= newest) continue;
      newest = batch.at_s[i];
      const place = this.count % CAPACITY;
      this.at[place] = newest;
      this.phases[place] = batch.playing ? batch.phase : "";
      for (const [name, column] of this.columns) {
        const values = batch[name] ?? batch.second?.[OF_SECOND[name]];
        column[place] = values?.[i] ?? NaN;
      }
      this.gaps[place] = batch.after_gap[i] ? 1 : 0;
      this.count += 1;
    }
    this.now_s = Math.max(batch.now_s, newest);
    this.clock_s ??= now_s() - this.now_s;
    this.dropped += batch.dropped;
    this.version += 1;
  }

  /** Index of the first sample that is not older than a time; indices grow with time. */
  since(at_s) {
    let low = Math.max(0, this.count - CAPACITY);
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.at[middle % CAPACITY] < at_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  time(index) {
    return this.at[index % CAPACITY];
  }

  phase(index) {
    return this.phases[index % CAPACITY];
  }

  part(index) {
    return this.phase(index);
  }

  hue(index) {
    return HUES[this.phase(index)];
  }

  /** Whether samples are missing before one; those that came late are not. */
  gap(index) {
    return this.gaps[index % CAPACITY] === 1;
  }

  value(name, index) {
    const minus = ERRORS[name];
    if (minus) return this.value(minus[0], index) - this.value(minus[1], index);
    return this.columns.get(name)[index % CAPACITY];
  }

  /** The newest value there is of a quantity; NaN where the last second has none. */
  latest(name, within_s = 1) {
    const oldest = this.since((this.now_s ?? 0) - within_s);
    for (let index = this.count - 1; index >= oldest; index -= 1) {
      if (Number.isFinite(this.value(name, index))) return this.value(name, index);
    }
    return NaN;
  }

  /** The sample nearest to a time, or null where none is near. */
  nearest(at_s, within_s = 0.5) {
    const after = this.since(at_s);
    const candidates = [after - 1, after].filter(
      (index) => index >= Math.max(0, this.count - CAPACITY) && index < this.count);
    candidates.sort((a, b) => Math.abs(this.time(a) - at_s) - Math.abs(this.time(b) - at_s));
    const best = candidates[0];
    return best !== undefined && Math.abs(this.time(best) - at_s) <= within_s ? best : null;
  }
}
