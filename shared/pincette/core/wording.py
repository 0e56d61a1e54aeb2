"""Texts for people, made from codes and numbers in this one place."""

from collections.abc import Mapping, Sequence

from pincette.control.faults import INSTRUMENT
from pincette.core.faults import Cause, Fault, FaultCode
from pincette.core.messages import Applied, Status

TEXTS: Mapping[FaultCode, str] = {
    FaultCode.NO_ACQUISITION: "the buffered acquisition has delivered no sample",
    FaultCode.READING_NOT_FINITE: "position {x_um} µm is not a number",
    FaultCode.READING_OUT_OF_RANGE: (
        "position {x_um:.3f} µm is outside the sensor's range {minimum_um:g}..{maximum_um:g} µm"
    ),
    FaultCode.POSITION_OUT_OF_RANGE: (
        "sensor: position {x_um:g} µm is outside {minimum_um:g}..{maximum_um:g} µm"
    ),
    FaultCode.SENSOR_STUCK: (
        "sensor stuck: {x_um:.3f} µm in {samples:.0f} samples while the voltage moved"
    ),
    FaultCode.MEMORY_UNKNOWN: (
        "the earlier voltages of the arm are not known, since the estimator was started or "
        "the output failed: x_1 may err by {error_um:.2f} µm beyond {highest_V:.2f} V, "
        "which the uncertainty of the force includes; a grip, or a move of the empty arm to "
        "that voltage, ends this state"
    ),
    FaultCode.MODEL_MISMATCH: (
        "the stroke of the arm has changed by {change_percent:+.2f} % since its calibration, "
        "explained are ±{limit_percent:.2f} %: the free response is corrected by it, and the "
        "uncertainty of the force covers that the sensor may be the cause; beyond "
        "{most_percent:g} % no force is zeroed. Find the cause. If it is the amplifier or the "
        "temperature of the piezo, run the calibration gain_check and accept it; if it is the "
        "sensor, correct its scale"
    ),
    FaultCode.NO_APPLIED_VOLTAGE: "no voltage for the sample before",
    FaultCode.FORCES_DISAGREE: (
        "both arms hold one part, and their forces differ by {difference_mN:.2f} mN, with "
        "an uncertainty of ±{uncertainty_mN:.2f} mN: the free response of one arm is wrong, "
        "or something else holds the part; calibrate free_response of both"
    ),
    FaultCode.ZERO_PART_HELD: "zero refused: a part is held, and its force would be zeroed",
    FaultCode.ZERO_TOO_FEW_SAMPLES: (
        "zero refused: {samples:.0f} samples of rest, must be {wanted_samples:.0f}"
    ),
    FaultCode.ZERO_NOT_SETTLED: (
        "zero refused: the arm has not settled, it moved by {spread_um:.3f} µm in "
        "{samples:.0f} samples, limit {limit_um:.3g} µm at a noise of {noise_um:.3g} µm: "
        "let the arm come to rest, or calibrate `noise` if the sensor is noisier than that"
    ),
    FaultCode.ZERO_BEYOND_FIRST_TOUCH: (
        "zero refused: the arm rests at {x_um:.3f} µm, where it may touch the part, "
        "limit {limit_um:.3f} µm"
    ),
    FaultCode.ZERO_TOUCHED: (
        "zero refused: the arm touched something at {touch_x_um:.3f} µm, which has pushed it back "
        "by {back_um:.3f} µm since, limit {limit_um:.3f} µm"
    ),
    FaultCode.ZERO_OFFSET: (
        "zero refused: the offset would change by {change_um:.3f} µm, limit {limit_um:.3f} "
        "µm after {travel_um:.1f} µm of travel, and hide what pushes the arm: make sure "
        "that nothing touches it, then send zero_confirmed = true"
    ),
    FaultCode.ZERO_FIRST_OFFSET: (
        "zero refused: the offset would change by {change_um:.3f} µm, limit {limit_um:.3f} "
        "µm after {travel_um:.1f} µm of travel; without a zero since the arming, x_1 is "
        "relative to where the arm was found: if it touched something there, remove it or "
        "open the gripper, and arm again"
    ),
    FaultCode.ZERO_INVALID: (
        "the zero of the force is no longer valid: an arm that pressed a part reads a pull of "
        "{pull_mN:.2f} mN, with an uncertainty of ±{uncertainty_mN:.2f} mN, at a voltage at which "
        "no part can pull it. The part was removed, or the sensor jumped, and the force is "
        "unknown: release, then the next job zeroes the force again"
    ),
    FaultCode.VOLTAGE_NOT_FINITE: "{voltage_V} V is not a voltage",
    FaultCode.VOLTAGE_ABSURD: (
        "{voltage_V:g} V is impossible, the range is {minimum_V} V to {maximum_V} V"
    ),
    FaultCode.FORCE_NOT_FINITE: "{force_mN} mN is not a force",
    FaultCode.TARGET_NOT_FINITE: "{x_d_um} µm is not a position",
    FaultCode.OTHER_EPOCH: "command of epoch {epoch:.0f}, armed for {armed_epoch:.0f}",
    FaultCode.OTHER_OWNER: "command of owner {owner:.0f}, armed for {armed_owner:.0f}",
    FaultCode.COMMAND_AHEAD: "command {seq:.0f} is ahead, the newest sample is {newest_seq:.0f}",
    FaultCode.OTHER_ARMS: (
        "it is for {arms:.0f} driven arms, the rig has {wanted_arms:.0f}: start all programs with "
        "the same rig file"
    ),
    FaultCode.COMMAND_REPEATED: "command {seq:.0f} after {taken_seq:.0f}",
    FaultCode.SAMPLE_NOT_SEEN: "its sample is unknown here",
    FaultCode.COMMAND_TOO_LATE: "{age_ms:.0f} ms old, limit {limit_ms:.0f} ms",
    FaultCode.COMMAND_SAMPLES_TOO_OLD: "{samples:.0f} samples old, limit {limit_samples:.0f}",
    FaultCode.NOT_ARMED: "the actuator is not armed",
    FaultCode.SWEEP_TOO_WIDE: "sweep of ±{amplitude_V} V, limit ±{limit_V} V",
    FaultCode.SWEEP_OUT_OF_RANGE: (
        "sweep from {low_V:.3f} V to {high_V:.3f} V, limits {minimum_V} V and {maximum_V} V"
    ),
    FaultCode.FORCE_BEYOND_LIMIT: "{force_mN:.1f} mN, limit {limit_mN:.1f} mN",
    FaultCode.FOLLOWING_BEYOND_LIMIT: (
        "the arm is at {x_um:.2f} µm, target {x_d_um:.2f} µm: off by {error_um:.2f} µm, "
        "limit {limit_um:.2f} µm"
    ),
    FaultCode.POSITION_BEYOND_LIMITS: (
        "{x_um:.2f} µm, limits {minimum_um:.2f} µm and {maximum_um:.2f} µm"
    ),
    FaultCode.NO_COMMAND: "no command for {silent_ms:.0f} ms, limit {limit_ms:.0f} ms",
    FaultCode.FREEZE_RELEASED: "released: {force_mN:.1f} mN, limit {limit_mN:.1f} mN",
    FaultCode.OUTPUT_UNCONFIRMED: "the frozen voltage is not confirmed",
    FaultCode.REQUESTED: "",
    FaultCode.SECOND_CONTROLLER: "alarm: {commands:.0f} commands from another controller refused",
    FaultCode.STANDSTILLS: "{times:.0f} scheduling stalls",
    FaultCode.SUSPENDED: "the machine was suspended for {slept_s:.1f} s",
    FaultCode.EXCHANGE_TIMES: "",
    FaultCode.LAW_NUMBER: "",
    FaultCode.ACTUATOR_TRIPPED: "the actuator has tripped",
    FaultCode.LEASE_ENDED: (
        "lease: nothing received from the supervisor for {silent_s:.1f} s, limit {limit_s:g} s"
    ),
    FaultCode.RECORDER_STATE: "",
    FaultCode.RECORD_BEHIND: (
        "the newest {behind_s:.1f} s of the record are not on the disk yet, limit "
        "{limit_s:g} s: check what else writes to the disk"
    ),
    FaultCode.RECORD_DAMAGED: (
        "{records:.0f} records differ from their manifests: copy the files from a backup"
    ),
    FaultCode.CLOCK_STEPPED: (
        "the time of day has stepped by {step_s:+.0f} s against the recorder's counted "
        "time; records are not deleted until a person sets the clock right, or acknowledges "
        "the alarm"
    ),
    FaultCode.MESSAGES_REFUSED: (
        "refused {messages:.0f} messages, the last {age_s:.0f} s ago; another program sends on "
        "this rig's keys"
    ),
}
"""Text of each fault code; faults of an instrument have their driver's text."""
UNKNOWN_FORCE: Mapping[FaultCode, str] = {
    FaultCode.FREEZE_RELEASED: (
        "released: the force is unknown, since the output does not confirm its voltage; "
        "limit {limit_mN:.1f} mN"
    ),
}
"""Texts that replace those of ``TEXTS`` if the fault does not contain the force."""
IN_A_ROW = frozenset(
    {
        FaultCode.FORCE_BEYOND_LIMIT,
        FaultCode.FOLLOWING_BEYOND_LIMIT,
        FaultCode.POSITION_BEYOND_LIMITS,
        FaultCode.FREEZE_RELEASED,
    }
)
SUBJECTS: Mapping[FaultCode, str] = {
    **dict.fromkeys((*INSTRUMENT, FaultCode.READING_NOT_FINITE), "sensor"),
    FaultCode.READING_OUT_OF_RANGE: "sensor",
    FaultCode.NO_ACQUISITION: "sensor",
    FaultCode.VOLTAGE_NOT_FINITE: "the law",
    FaultCode.VOLTAGE_ABSURD: "the law",
    FaultCode.FORCE_NOT_FINITE: "the law",
    FaultCode.TARGET_NOT_FINITE: "the law",
    FaultCode.FORCE_BEYOND_LIMIT: "force",
    FaultCode.FOLLOWING_BEYOND_LIMIT: "following_error",
    FaultCode.POSITION_BEYOND_LIMITS: "position",
}
"""Subject of a fault, if its cause does not name it."""
ARMS: Mapping[float, str] = {1.0: "first arm", 2.0: "second arm"}
"""Names of the arms on a rig with two."""
NAMES_ITS_COMMAND = frozenset({FaultCode.COMMAND_AHEAD, FaultCode.COMMAND_REPEATED})
MEANINGS: Mapping[Cause, str] = {
    Cause.ABORT: "the job was aborted",
    Cause.ESTOP: "an emergency stop was requested",
    Cause.RESTART: "the actuator was restarted",
}
"""Meanings of causes without numbers."""
NOT_A_NUMBER = float("nan")


def fault_text(fault: Fault | None) -> str:
    """Return a fault as text: value, unit and limit; empty if there is no fault."""
    if fault is None:
        return ""
    values = {
        item.name: NOT_A_NUMBER if item.value is None else item.value for item in fault.values
    }
    if fault.code is FaultCode.LAW_NUMBER:
        return ", ".join(f"the law: {name} = {value}" for name, value in values.items())
    if fault.code is FaultCode.EXCHANGE_TIMES:
        took = ", ".join(
            f"{name.removesuffix('_s').replace('_', ' ')} {1e3 * value:.1f} ms"
            for name, value in values.items()
        )
        return f"the newest exchanges with the instruments took: {took}"
    if fault.code is FaultCode.RECORDER_STATE:
        counts = (f"{value:.0f} {name.replace('_', ' ')}" for name, value in values.items())
        return "; ".join((fault.words, *counts))
    template = TEXTS.get(fault.code, "")
    if fault.number("force_mN") is None:
        template = UNKNOWN_FORCE.get(fault.code, template)
    text = template.format_map(_with_milliseconds(values))
    if fault.code in IN_A_ROW and "samples" in values:
        text = f"{text}, {values['samples']:.0f} samples in a row"
    if "arm" in values:
        text = ": ".join(filter(None, (ARMS.get(values["arm"], ""), text)))
    if "seq" in values and fault.code not in NAMES_ITS_COMMAND:
        text = f"command {values['seq']:.0f}: {text}"
    return ": ".join(part for part in (text, fault.words) if part)


def _with_milliseconds(values: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers of a fault, with times also in ms."""
    times = {name: value for name, value in values.items() if name.endswith("_s")}
    return {**values, **{f"{name[:-2]}_ms": 1e3 * value for name, value in times.items()}}


def named_text(fault: Fault | None) -> str:
    """Return a fault as text, preceded by its subject."""
    text = fault_text(fault)
    if fault is None or not text or fault.number("seq") is not None:
        return text
    subject = SUBJECTS.get(fault.code)
    return text if subject is None else f"{subject}: {text}"


def faults_text(faults: Sequence[Fault]) -> str:
    """Return several faults as text, in order."""
    return "; ".join(filter(None, map(named_text, faults)))


def cause_text(cause: Cause, faults: Sequence[Fault] = (), silent: str = "") -> str:
    """Return, as text, why a rig is latched.

    ``silent`` names the program whose command was missed.
    """
    first = fault_text(faults[0]) if faults else ""
    rest = [named_text(fault) for fault in faults[1:]]
    if silent and faults and faults[0].code is FaultCode.NO_COMMAND:
        silent_ms, limit_ms = (
            1e3 * (faults[0].number(name) or 0.0) for name in ("silent_s", "limit_s")
        )
        first = f"{silent} silent for {silent_ms:.0f} ms, limit {limit_ms:.0f} ms"
    if cause in MEANINGS:
        first, rest = MEANINGS[cause], [first, *rest]
    named = ": ".join(filter(None, (str(cause), first)))
    return "; ".join(filter(None, (named, *rest)))


def applied_text(applied: Applied) -> str:
    """Return, as text, why the actuator has tripped."""
    return cause_text(applied.cause, applied.faults)


def status_text(status: Status) -> str:
    """Return the status of a program as text; empty if there is nothing to report."""
    mode = "" if status.mode is None else str(status.mode)
    cause = cause_text(status.cause, status.faults) if status.cause else ""
    return "; ".join(filter(None, (mode, cause, faults_text(status.findings))))
