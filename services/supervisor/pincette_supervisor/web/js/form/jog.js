// Jogging the free arm by steps, and teaching poses: each press is a move, each pose a move's end.

import { jobsOfRig, startJob, told } from "../api.js";
import { h, setText, show } from "../dom.js";
import { withUnit } from "../words.js";

const STEPS = [["by_um", 0.1, "µm"], ["by_um", 0.5, "µm"], ["by_um", 1, "µm"], ["by_um", 5, "µm"],
  ["by_V", 0.01, "V"], ["by_V", 0.05, "V"]];
const USUAL = 2;
const POSE_NAME = "[A-Za-z0-9_.\\-]{1,40}";

export class Jog {
  constructor({ recent, refresh, started, take }) {
    Object.assign(this, { recent, refreshAll: refresh, started, take });
    this.busy = false;
    this.kind = "";
    this.rig = null;
    this.poses = [];
    this.build();
  }

  build() {
    this.at = h("output", { class: "jog-at", id: "jog-at", for: "jog-less jog-more" });
    this.said = h("p", { class: "hint", id: "jog-said", role: "status" });
    this.step = h("select", { id: "jog-step" }, ...STEPS.map(([, size, unit], place) => h("option",
      { value: place, selected: place === USUAL }, `${size} ${unit}`)));
    const press = (id, sign, label, text) => h("button", { type: "button", id, class: "step",
      "data-needs": "operate",
      "aria-label": label, onclick: () => this.move(sign) }, text);
    this.name = h("input", { id: "jog-name", type: "text", autocomplete: "off",
      pattern: POSE_NAME, placeholder: "its name" });
    this.list = h("div", { id: "poses" });
    this.element = h("fieldset", { class: "jog", hidden: true }, h("legend", {}, "Jog and teach"),
      this.at,
      h("div", { class: "jog-row" }, press("jog-less", -1, "Step back, away from the part", "−"),
        h("label", { class: "unseen", for: "jog-step" }, "Step"), this.step,
        press("jog-more", 1, "Step forward, towards the part", "+")),
      h("div", { class: "jog-row" }, h("label", { for: "jog-name" }, "Pose"), this.name,
        h("button", { type: "button", id: "jog-teach", "data-needs": "operate",
          onclick: () => this.teach() }, "Teach")),
      this.said, this.list);
  }

  /** Make jobs of a kind, and list the poses that it has taught. */
  show(kind) {
    this.kind = kind;
    this.refresh();
  }

  /** Position of the arm by its newest sample. */
  tell() {
    if (this.element.hidden) return;
    const newest = (name) => {
      const value = this.recent.latest(name);
      return Number.isFinite(value) ? value : this.rig?.newest?.[name];
    };
    setText(this.at, `${withUnit(newest("x_um"), "µm")} · ${withUnit(newest("voltage_V"), "V", 3)}`);
  }

  follow(rig) {
    this.rig = rig;
    this.tell();
  }

  /** A job that has changed may have made room for the next step, or left a pose. */
  changed(job) {
    if (this.element.hidden || job?.kind !== this.kind || job.ended_at === null) return;
    const pose = job.result?.ends_at;
    setText(this.said, job.cause || (pose ? `at ${withUnit(pose.x_um, "µm")}` : job.state));
    this.refresh();
  }

  move(sign) {
    const [target, size, unit] = STEPS[Number(this.step.value)];
    this.start({ kind: this.kind, [target]: sign * size },
      `moving ${sign < 0 ? "back" : "forward"} by ${size} ${unit}`);
  }

  /** A pose is the end of a move; a move without a target states the present position. */
  teach() {
    if (!this.name.value || !this.name.checkValidity()) {
      setText(this.said, "The name of a pose may have letters, digits, dots, dashes and underscores.");
      this.name.focus();
      return;
    }
    this.start({ kind: this.kind, by_V: 0, zero: false, teach: this.name.value },
      `teaching ${this.name.value}`);
  }

  async start(body, doing) {
    if (this.busy || this.rig?.active_job) {
      setText(this.said, "The previous step is still running.");
      return;
    }
    this.busy = true;
    setText(this.said, doing);
    try {
      this.started(await startJob(body));
    } catch (problem) {
      setText(this.said, told(problem));
    } finally {
      this.busy = false;
    }
    this.refreshAll();
  }

  /** The poses that moves have taught, each name with its newest one. */
  async refresh() {
    const { jobs } = await jobsOfRig(`kind=${this.kind}&state=succeeded&limit=100`).catch(() => ({ jobs: [] }));
    const poses = new Map();
    for (const { result } of jobs) {
      if (result?.teach && !poses.has(result.teach)) poses.set(result.teach, result.ends_at);
    }
    this.poses = [...poses];
    show(this.list, this.poses, () => (this.poses.length ? h("ul", { class: "poses",
      "aria-label": "Poses" }, ...this.poses.map(([name, pose]) => this.pose(name, pose))) : []));
  }

  pose(name, { x_um, voltage_V }) {
    return h("li", {}, h("b", {}, name),
      h("span", { class: "muted" }, `${withUnit(x_um, "µm")} · ${withUnit(voltage_V, "V", 3)}`),
      h("button", { type: "button", class: "link", id: `pose-${name}`,
        "aria-label": `Use ${name} as the target of the move`,
        onclick: () => this.take({ target: "to_um", value: Number(x_um.toFixed(3)) }) }, "As target"));
  }
}
