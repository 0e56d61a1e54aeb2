// What can be asked for, field by field; what is left empty comes from the rig file.

const HOLD = [
  { name: "hold_s", label: "Hold", min: 0.1, max: 3600, step: "any" },
  { name: "until_released", label: "Hold until released", type: "check", excludes: "hold_s" },
];

export const KINDS = {
  grip: {
    label: "Grip", fields: [
      { name: "force_mN", label: "Force", min: 0.1, step: "any", limit: "force_max" },
      ...HOLD,
    ],
  },
  move: {
    label: "Move", fields: [
      { name: "target", label: "Target", type: "choice", choices: [
        ["to_um", "to a position, µm"], ["by_um", "by a distance, µm"],
        ["to_V", "to a voltage, V"], ["by_V", "by a voltage, V"]], names: "value" },
      { name: "value", label: "Value", step: "any", required: true },
      { name: "conditioning_cycles", label: "Conditioning cycles", min: 0, max: 20, step: 1,
        empty: "none" },
    ],
  },
  hold: { label: "Hold a part", fields: HOLD },
  release: {
    label: "Release a part", fields: [
      { name: "release_s", label: "Over", min: 0.1, max: 3600, step: "any" }],
  },
  track: {
    label: "Track a path", fields: [
      { name: "shape", label: "Shape", type: "choice", choices: [
        ["sinusoid", "sinusoid"], ["triangle", "triangle"], ["step", "steps"]] },
      { name: "force_pp_mN", label: "Height, peak to peak", min: 0.1, step: "any" },
      { name: "frequency_hz", label: "Frequency", min: 0.001, step: "any" },
      { name: "cycles", label: "Cycles", min: 1, max: 1000, step: 1 },
    ],
  },
  calibrate: {
    label: "Calibrate", fields: [
      { name: "calibration", label: "Calibration", type: "choice", choices: [
        ["noise", "noise of the sensor"], ["free_response", "free response"],
        ["compliance", "compliance, with weights"], ["contact_stiffness", "contact stiffness"],
        ["frequency_response", "frequency response"]] },
    ],
  },
};

/** What the phases of a plan say about values that a request left out. */
export function defaultsOf(plan) {
  const phase = (name) => plan.phases?.find((each) => each.phase === name);
  const rounded = (value) => (value === undefined ? undefined : Number(value.toFixed(4)));
  return { force_mN: rounded(phase("load")?.force_mN), hold_s: rounded(phase("hold")?.duration_s) };
}
