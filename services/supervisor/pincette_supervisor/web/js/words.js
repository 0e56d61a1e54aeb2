// Numbers, times and states as people read them.

const MINUS = "\u2212";
const NONE = "–";

/** A number with a fixed count of decimals; a dash where there is none. */
export function number(value, decimals = 2) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  const text = Math.abs(value).toFixed(decimals);
  const negative = value < 0 && Number(text) !== 0;
  return negative ? MINUS + text : text;
}

/** A number to some significant digits, for quantities of any size. */
export function significant(value, digits = 4) {
  if (typeof value !== "number" || !Number.isFinite(value)) return NONE;
  if (Number.isInteger(value) && Math.abs(value) < 1e6) return String(value).replace("-", MINUS);
  const size = value === 0 ? 0 : Math.floor(Math.log10(Math.abs(value)));
  if (size < -3 || size > 6) return value.toExponential(digits - 1).replace("-", MINUS);
  return number(value, Math.max(0, digits - 1 - size));
}

export function withUnit(value, unit, decimals = 2) {
  const text = number(value, decimals);
  return text === NONE ? NONE : `${text} ${unit}`;
}

/** A force with its uncertainty. */
export function force(value_mN, uncertainty_mN) {
  if (value_mN === null || value_mN === undefined) return NONE;
  const more = uncertainty_mN ? ` ± ${number(uncertainty_mN, 2)}` : "";
  return `${number(value_mN, 2)}${more} mN`;
}

export function duration(seconds) {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return NONE;
  if (seconds < 10 && !Number.isInteger(seconds)) return `${number(seconds, 1)} s`;
  if (seconds < 90) return `${Math.round(seconds)} s`;
  return `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
}

let ahead_ms = 0; // by which the server's clock is ahead of the browser's

/** Take the time of the server from the head of an answer, which has whole seconds; what is less is no difference. */
export function setNow(date) {
  const found_ms = Date.parse(date ?? "") + 500 - Date.now();
  if (Number.isFinite(found_ms)) ahead_ms = Math.abs(found_ms) < 2000 ? 0 : found_ms;
}

/** The server's time in seconds since 1970. */
export const now_s = () => (Date.now() + ahead_ms) / 1000;

/** Whether the clocks change on the local day of a time, so that an hour may occur twice. */
function clocksChange(time) {
  const [from, to] = [0, 1].map((days) => new Date(time.getFullYear(), time.getMonth(), time.getDate() + days));
  return from.getTimezoneOffset() !== to.getTimezoneOffset();
}

/** A UTC time as local time; with the offset from UTC on a day on which the clocks change. */
export function clock(text) {
  if (!text) return NONE;
  const time = new Date(text);
  const today = new Date(1000 * now_s()).toDateString() === time.toDateString();
  const options = { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false };
  if (clocksChange(time)) options.timeZoneName = "shortOffset";
  const day = today ? "" : `${time.toLocaleDateString("en-GB", { day: "numeric", month: "short" })} `;
  return day + time.toLocaleTimeString("en-GB", options);
}

/** "no_contact" as "no contact". */
export const plain = (code) => String(code ?? "").replaceAll("_", " ");

/** What kind of news a job's state is. */
export function toneOfState(state) {
  if (state === "succeeded") return "good";
  if (["failed", "aborted", "aborting", "interrupted"].includes(state)) return "bad";
  if (["stopped", "stopping", "paused", "pausing", "resuming", "awaiting_recovery",
    "proposed"].includes(state)) return "warn";
  return state === "running" ? "busy" : "muted";
}

const UNITS = [["_um_per_s2", "µm/s²"], ["_mN_per_um", "mN/µm"], ["_um_per_mN", "µm/mN"], ["_um_per_s", "µm/s"],
  ["_um_per_V", "µm/V"], ["_V_per_s", "V/s"], ["_rad_per_s", "rad/s"], ["_mN", "mN"],
  ["_um", "µm"], ["_V", "V"], ["_s", "s"], ["_hz", "Hz"]];
const suffixOf = (name) => UNITS.find(([suffix]) => name.endsWith(suffix)) ?? ["", ""];

/** The unit that a field name carries as its suffix. */
export const unitOf = (name) => suffixOf(name)[1];

/** A field name in words, without its unit. */
export const withoutUnit = (name) => plain(name.slice(0, name.length - suffixOf(name)[0].length));
