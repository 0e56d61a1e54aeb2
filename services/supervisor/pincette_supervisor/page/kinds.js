// What can be asked for, field by field; what is left empty comes from the rig file. A field with
// `when` belongs to certain choices of another one, and is else neither seen nor sent.

const number = (name, label, more = {}) => ({ name, label, type: "number", step: "any", ...more });
const choice = (name, label, choices, more = {}) => ({ name, label, type: "choice", choices, ...more });
const AS_USUAL = ["", "as in the rig file"];

const RECIPE = { name: "recipe", label: "Recipe", type: "choice", source: "recipes" };
const ENDS = [
  choice("on_stop", "A stop", [["", "keeps the part held"], ["release", "lets the part go"],
    ["retract", "lets it go and retreats"]]),
  choice("on_abort", "An abort", [["", "keeps the part for a while"], ["ramp", "lets go at once"]]),
];
const LAW = [
  number("load_s", "Load over", { min: 0.1, max: 3600 }),
  number("approach_um_per_s", "Approach at", { min: 0.1, max: 1000 }),
  number("seek_um_per_s", "Seek contact at", { min: 0.1, max: 1000 }),
  choice("scheme", "Law", [AS_USUAL, ["pbsmic", "PBSMIC"], ["dsmifc", "DSMIFC"]]),
  choice("gains", "Gains", [AS_USUAL, ["tuned", "tuned on the model"]]),
];
const CYCLES = [
  number("low_V", "Cycles from"), number("high_V", "Cycles to"),
  number("rate_V_per_s", "Cycles at", { min: 0 }),
];

const SWINGS = { shape: ["sinusoid", "triangle"] };
const of = (...calibrations) => ({ calibration: calibrations });

export const KINDS = {
  grip: {
    label: "Grip", fields: [
      RECIPE,
      number("force_mN", "Force", { min: 0.1, limit: "force_max" }),
      number("hold_s", "Hold", { min: 0.1, max: 3600 }),
      { name: "until_released", label: "Hold until released", type: "check", excludes: "hold_s" },
    ],
    more: [...LAW, ...ENDS],
  },
  track: {
    label: "Track a path", fields: [
      RECIPE,
      choice("shape", "Shape", [["sinusoid", "sinusoid"], ["triangle", "triangle"],
        ["step", "steps"], ["waypoints", "waypoints"]]),
      number("force_mean_mN", "Mean", { min: 0.1, limit: "force_max", when: SWINGS }),
      number("force_pp_mN", "Height, peak to peak", { min: 0.1, when: SWINGS }),
      number("frequency_hz", "Frequency", { min: 0.001, when: SWINGS }),
      number("cycles", "Cycles", { min: 1, max: 1000, step: 1, when: SWINGS }),
      { name: "levels_mN", label: "Levels", type: "list", when: { shape: ["step"] },
        empty: "as in the rig file; e.g. 5, 10" },
      number("dwell_s", "Stay at each", { min: 0.1, max: 3600, when: { shape: ["step"] } }),
      { name: "points", label: "Points, one a line: time in s, force in mN", type: "pairs",
        pair: ["t_s", "force_mN"], when: { shape: ["waypoints"] }, empty: "0 5\n2 10\n4 5" },
    ],
    more: [number("rate_um_per_s", "Path at most at", { min: 0.1, max: 1000 }), ...LAW, ...ENDS],
  },
  move: {
    label: "Move the free arm", fields: [
      choice("target", "Target", [["to_um", "to a position"], ["by_um", "by a distance"],
        ["to_V", "to a voltage"], ["by_V", "by a voltage"]], { names: true }),
      number("value", "Value", { required: true, namedBy: "target" }),
      number("speed_um_per_s", "Peak speed", { min: 0.1, max: 1000 }),
      number("conditioning_cycles", "Conditioning cycles", { min: 0, max: 20, step: 1, empty: "none" }),
      number("warm_up_s", "Warm up for", { min: 0, max: 3600, empty: "not" }),
    ],
    more: CYCLES,
  },
  hold: {
    label: "Hold a part", fields: [
      number("hold_s", "Hold", { min: 0.1, max: 3600, empty: "until released" }),
      number("release_s", "Let go over", { min: 0.1, max: 3600 }),
    ],
    more: ENDS,
  },
  release: {
    label: "Release a part",
    fields: [number("release_s", "Let go over", { min: 0.1, max: 3600 })],
  },
  calibrate: {
    label: "Calibrate", fields: [
      choice("calibration", "Calibration", [["noise", "noise of the sensor"],
        ["free_response", "free response"], ["compliance", "compliance, with weights"],
        ["contact_stiffness", "contact stiffness"], ["frequency_response", "frequency response"]]),
      number("duration_s", "For", { min: 1, max: 600, empty: "as usual",
        when: of("noise", "frequency_response") }),
      number("low_V", "Lowest voltage", { when: of("free_response") }),
      number("high_V", "Highest voltage", { when: of("free_response") }),
      { name: "weights_mN", label: "Weights, from 0", type: "list", when: of("compliance"),
        empty: "0, 5, 10, 20" },
      { name: "levels_V", label: "Levels, peak to peak", type: "list",
        when: of("contact_stiffness"), empty: "as the limits allow" },
      number("from_hz", "From", { min: 0.1, when: of("frequency_response"), empty: "as usual" }),
      number("to_hz", "To", { min: 0.1, when: of("frequency_response"), empty: "as usual" }),
    ],
  },
};

/** What the phases of a plan say about values that a request left out. */
export function defaultsOf(plan) {
  const phase = (name) => plan.phases?.find((each) => each.phase === name);
  const rounded = (value) => (value === undefined ? undefined : Number(value.toFixed(4)));
  return { force_mN: rounded(phase("load")?.force_mN), hold_s: rounded(phase("hold")?.duration_s) };
}
