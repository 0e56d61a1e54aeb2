"""Results of jobs, as they are stored and sent."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from pincette.api import Model, example
from pincette.api.places import PlaceFound
from pincette.api.plans import Pose
from pincette.api.states import ActionType


class Phase(Model):
    """A phase that was executed."""

    model_config = example(phase="hold", start_s=8.9, duration_s=4.0)

    phase: str
    start_s: float
    duration_s: float


class Percentiles(Model):
    """Percentiles of a magnitude; the unit is the suffix of the name."""

    model_config = example(p50=0.021, p95=0.064, p99=0.091)

    p50: float
    p95: float
    p99: float


class LimitActed(Model):
    """A limit of the actuator that was active."""

    model_config = example(limit="slew_up", first_seq=344, samples=3)

    limit: str
    first_seq: int
    samples: int


class ActionTaken(Model):
    """An action and the sample at which it took effect."""

    model_config = example(type="release", seq=611)

    type: ActionType
    seq: int


class Tracking(Model):
    """Statistics of the error (actual value minus reference) during a hold or a path. The unit is
    the suffix of the member's name.
    """

    model_config = example(rmse=0.087, rmse_percent=0.95, maximum=0.29)

    rmse: float
    rmse_percent: float | None
    """Root mean square error relative to the reference's peak-to-peak range; null if the reference
    is constant.
    """
    maximum: float
    """Largest magnitude of the error."""


CAUSES: dict[str, Any] = {
    "total": 0.039,
    "noise": 0.036,
    "response": 0.004,
    "contact_line": 0.011,
    "lag": 0.006,
    "limits": 0.0,
    "largest": "noise",
    "to_do": "the sensor's noise is the floor: only a better sensor can reduce it",
}


class ErrorCauses(Model):
    """Contributions to an error, by cause. Each is a root mean square; its unit is the suffix of
    the parent's name.

    Squares of the contributions can be added; if two causes partly cancel, the total is smaller.
    """

    model_config = example(**CAUSES)

    total: float
    """Total error of the measured position, or expected total error of the true force."""
    noise: float
    """Contribution that is not the same in each cycle; for the force, the effect of the resulting
    motion of the arm.
    """
    response: float
    """Contribution from the error of the free-arm model; for the force, as stated by the
    estimator.
    """
    contact_line: float
    """Contribution from the deviation of force estimate and position from the contact line of the
    references.
    """
    lag: float
    """Contribution that is proportional to velocity and acceleration of the reference."""
    limits: float
    """Contribution from samples during and shortly after an active voltage limit."""
    largest: Literal["noise", "response", "contact_line", "lag", "limits"]
    to_do: str
    """Change that would reduce the largest contribution to the error."""


class ErrorSources(Model):
    """Causes of the errors during a hold or a path."""

    model_config = example(position_um=CAUSES, force_mN=CAUSES)

    position_um: ErrorCauses
    force_mN: ErrorCauses


class Goal(Model):
    """Result of the comparison of a job's errors with their tolerances."""

    model_config = example(
        met=True,
        settling_s=0.5,
        settled_s=0.32,
        position_tolerance_um=0.2,
        position_error_um=0.11,
        force_tolerance_mN=0.5,
        force_error_mN=0.34,
    )

    met: bool | None
    """True if the errors stayed within their tolerances; null if the phase was not longer than the
    settling time, so that no statement is possible.
    """
    settling_s: float
    """Time, from the beginning of the hold, path or rest, after which every error must stay within
    its tolerance.
    """
    settled_s: float | None
    """Time, from the same beginning, after which every error stays within its tolerance; null if
    there is no such time, or the job did not reach that phase.
    """
    position_tolerance_um: float | None
    position_error_um: float | None
    """Largest magnitude of x minus x_r after the settling time; null if there is none."""
    force_tolerance_mN: float | None
    force_error_mN: float | None
    """Largest magnitude of the estimate minus F_r after the settling time."""


class ZeroReturn(Model):
    """Estimated force when the free arm returns to the position at which the force was zeroed.

    Except for the error of the free response it should be 0. It reveals drift or a jump of the
    sensor, an unnoticed slip, or a large change of a gain.
    """

    model_config = example(force_mN=-0.11, uncertainty_mN=0.42, x_um=26.0, verified=True)

    force_mN: float
    """Mean estimate over the samples near ``x_um`` while the arm returns."""
    uncertainty_mN: float
    """Expanded uncertainty, from the zero returns of rehearsed grips. If the model contains none,
    it follows from the residual of the free response, or is that of the estimator without one.
    """
    x_um: float
    """Position at which the force was zeroed."""
    verified: bool
    """False if the force exceeds its uncertainty. The forces estimated since the zeroing are then
    not verified.
    """


class ReleaseVerdict(Model):
    """Verdict on the release of a part, from the motion of the arm during its return.

    An arm that a part holds moves less than a free one, whether the part is pressed or pulled. A
    part that sticks to this arm only and moves with it exerts no force: only a camera can detect
    it.
    """

    model_config = example(
        verdict="released",
        strategies=["retreat"],
        stiffness_mN_per_um=0.02,
        stiffness_uncertainty_mN_per_um=0.11,
        pull_off_mN=0.24,
        pull_off_uncertainty_mN=0.09,
    )

    verdict: Literal["released", "sticks", "unknown"]
    """``released`` if the arm moves like a free arm, ``sticks`` if it moves like an arm held by the
    part, ``unknown`` if both or neither are possible within the uncertainty, or if the motion is
    free but a pull remains.
    """
    strategies: list[str]
    """Release strategies that were tried, in order; empty if the release used none."""
    stiffness_mN_per_um: float | None
    """Stiffness that acts on the arm at the end of its return; about 0 for a free arm; null if the
    return is too short to measure it.
    """
    stiffness_uncertainty_mN_per_um: float | None
    """Expanded uncertainty of ``stiffness_mN_per_um``."""
    pull_off_mN: float | None
    """Pulling force at which the part came off; 0 if it is hidden by noise and speed; null if it
    did not come off, or may have come off before the release (``zero_invalid``). A liquid bridge
    may continue to pull for a short distance.
    """
    pull_off_uncertainty_mN: float | None
    """Expanded uncertainty of the pull-off force; a slower return reduces it."""


StepCause = Literal["slip", "sensor", "unknown"]


class PositionStep(Model):
    """A step in the measured position of a pressed part that the voltage does not explain.

    At constant voltage one arm and one sensor cannot distinguish a part that slips from a sensor
    that jumps towards the part: the force after the step is either ``force_if_slip_mN`` or
    ``force_if_sensor_mN``.
    """

    model_config = example(
        cause="unknown",
        at_s=3.52,
        x_um=40.8,
        step_um=2.1,
        slip_um=4.2,
        slips=0,
        force_mN=15.0,
        force_if_slip_mN=10.6,
        force_if_sensor_mN=15.0,
    )

    cause: StepCause
    """``slip``: the part slipped. ``sensor``: the sensor jumped, or the arm was pushed.
    ``unknown``: neither the direction of the step nor the force estimate of the free arm afterwards
    is conclusive.
    """
    at_s: float
    """Time at which the step was confirmed."""
    x_um: float
    """Position just before the step."""
    step_um: float
    """Step of the position, positive towards the part; the sum if there were several steps."""
    slip_um: float | None
    """Distance by which the part slipped, if a slip is possible and the stiffness of the part is
    known.
    """
    slips: int
    """Number of slips of the part during a load."""
    force_mN: float
    """Estimated force just before the step."""
    force_if_slip_mN: float | None
    """Force just after the step, if the part slipped; null if a slip is impossible."""
    force_if_sensor_mN: float | None
    """Force just after the step, if the sensor jumped; null if the part certainly slipped."""
    rang: bool | None = None
    """Hint: true if the pressed arm oscillated after the step, as it does after a slip but not
    after a sensor jump. False proves nothing, since friction may damp the oscillation. Null if the
    voltage changed at that time.
    """


OutcomeCode = Literal[
    "gripped",
    "tracked",
    "released",
    "moved",
    "stopped",
    "no_contact",
    "wrong_stiffness",
    "uncertain_force",
    "lost",
    "overforce",
    "overtravel",
    "contact",
    "zero_refused",
    "slipped",
    "sensor_jump",
    "position_step",
    "tripped",
    "unfinished",
]


class ArmUse(Model):
    """Strokes, contacts and duration of a job; with two arms, the strokes are those of the arm that
    made more of them.
    """

    model_config = example(strokes=3, contacts=1, duration_s=21.4)

    strokes: int
    """Number of motions towards the part by at least 5 % of the position range."""
    contacts: int
    """Number of contacts that the controller has confirmed."""
    duration_s: float
    """Time from the first sample to the last, with the loop armed."""


class JobResult(Model):
    """Members of every result."""

    model_config = example(
        outcome="unfinished",
        phases=[{"phase": "approach", "start_s": 0.4, "duration_s": 1.4}],
        limits_acted=[],
        actions=[],
        samples=90,
        missed_ticks=0,
        unanswered_ticks=0,
        dropped_messages=0,
        touch_x_um=None,
        touch_force_mN=None,
    )

    outcome: OutcomeCode
    """End of the motion program: as the controller reported it; ``tripped`` if the actuator
    reported a trip; ``unfinished`` if neither reported an end.
    """
    phases: list[Phase]
    limits_acted: list[LimitActed]
    actions: list[ActionTaken]
    samples: int
    missed_ticks: int
    """Number of samples that were never taken or never arrived."""
    unanswered_ticks: int
    """Number of ticks in which the actuator accepted no command."""
    dropped_messages: int
    touch_x_um: float | None = None
    """Position at which the arm contacted something during its motion through free space."""
    touch_force_mN: float | None = None
    """Force at the contact of ``touch_x_um`` when the arm turned back, from the free response or
    from the slope of its motion."""
    position_step: PositionStep | None = None
    """Step of the position that the voltage does not explain; null if there was none."""
    goal: Goal | None = None
    """Comparison of the errors with the tolerances; null if the request has none."""
    place: PlaceFound | None = None
    """Comparison of the place where the part was found with the stated place; null if none was
    stated.
    """
    use: ArmUse | None = None
    """Strokes, contacts and duration; null for a job of a version that did not count them."""


class LoadForces(Model):
    """Smallest and largest estimated force during a load."""

    model_config = example(lowest_mN=2.1, highest_mN=20.1)

    lowest_mN: float
    highest_mN: float


class ClosedLoopResult(JobResult):
    """Result of a job with a control law. A value is null if the job did not reach its phase."""

    contact_load: LoadForces | None = None
    """Force range over which stiffness and place of the contact are averaged; null without a load.
    A part with a round face is softer at smaller and stiffer at larger forces, and contact begins
    slightly before that place.
    """
    contact_x_um: float | None
    contact_x_error_um: float | None
    """Standard error of the contact place, from the deviation of the load from a straight line and
    the error of the force.
    """
    contact_stiffness_mN_per_um: float | None
    contact_stiffness_error_mN_per_um: float | None
    """Standard error of the contact stiffness, from the deviation of the load from a straight
    line.
    """
    force_uncertainty_mN: float | None
    """Uncertainty of the force. For the hold of a grip it is that of the mean force, in which noise
    is averaged; otherwise that of single samples, averaged over the path.
    """
    force_assumed: list[str]
    """Quantities that contribute to the uncertainty and that no calibration has found."""
    zero_age_s: float | None
    """Time between the zeroing of the force and the end of the hold or the path."""
    stroke_change_percent: float | None = None
    """Change of the arm's stroke since its calibration, measured during an approach with
    conditioning strokes; null if the arm has not been conditioned since the estimator started.
    """
    stroke_limit_percent: float | None = None
    """Largest change of the stroke that noise and repeatability explain; if the change is larger,
    the force is corrected for it.
    """
    model_mismatch: bool = False
    """True if noise and repeatability do not explain the change of the stroke."""
    zero_unconfirmed: bool = False
    """True if nothing independent of the force estimate confirms that no part pressed on the arm
    while the force was zeroed. If a part did, all forces are too small by the force at that time. A
    part found at its planned place, or ``zero_confirmed``, counts as confirmation.
    """
    zero_invalid: bool = False
    """True if the zero of the force has become invalid, since a held part read a pull. The force is
    unknown from then on, and the forces before it may be wrong. A later job has this mark too if
    the part was still held when it began.
    """
    peak_force_mN: float | None
    final_force_mN: float | None
    """Force at the end of the job; null if it is not known there."""
    zero_return: ZeroReturn | None = None
    """Zero return; null if the free arm did not return to the position at which this job zeroed the
    force.
    """
    release: ReleaseVerdict | None = None
    """Verdict on the release at the end of the job; null if no part was released."""
    contact_rmse_position_um: float | None
    """Root mean square position error from the start of the load to the end of the unload."""
    contact_rmse_force_mN: float | None
    """Root mean square force error from the start of the load to the end of the unload."""
    sliding_um: Percentiles | None
    """Percentiles of |s| over all samples; the members down to ``true_perturbation_error_mN`` also
    cover all samples. With K_S = 0 nothing drives s to 0: it follows the perturbation and does not
    influence the voltage.
    """
    sliding_in_band: float | None
    """Fraction of samples with |s| within its band. Outside of the band a step of the law does not
    increase |s|."""
    residual_um: Percentiles | None
    """Magnitude of x minus its prediction (17), computed with the force that the law uses."""
    law_perturbation_mN: Percentiles | None
    """Magnitude of p̂ (6), computed with the law's force and parameter set."""
    perturbation_error_mN: Percentiles | None
    """Magnitude of p̃ (8), computed with the law's force and parameter set; K_S would have to
    exceed it. If the force is estimated from the same position and voltage, p̃ is the difference
    between two models.
    """
    true_perturbation_error_mN: Percentiles | None
    """Magnitude of p̃ (8) from the measured position, the applied voltage and the true force, with
    the law's parameter set; known only on a simulated rig, null on a real one."""


COMMON: dict[str, Any] = {
    "contact_load": {"lowest_mN": 2.1, "highest_mN": 20.1},
    "contact_x_um": 31.1,
    "contact_x_error_um": 0.01,
    "contact_stiffness_mN_per_um": 2.1,
    "contact_stiffness_error_mN_per_um": 0.004,
    "force_uncertainty_mN": 0.42,
    "force_assumed": ["model.forgotten_mN"],
    "zero_age_s": 9.1,
    "stroke_change_percent": 0.12,
    "stroke_limit_percent": 0.42,
    "model_mismatch": False,
    "peak_force_mN": 20.3,
    "final_force_mN": 0.1,
    "contact_rmse_position_um": 0.042,
    "contact_rmse_force_mN": 0.14,
    "sliding_um": {"p50": 0.09, "p95": 0.32, "p99": 0.41},
    "sliding_in_band": 0.41,
    "residual_um": {"p50": 0.021, "p95": 0.064, "p99": 0.091},
    "law_perturbation_mN": {"p50": 1.2, "p95": 6.1, "p99": 6.4},
    "perturbation_error_mN": {"p50": 0.1, "p95": 0.3, "p99": 0.4},
    "true_perturbation_error_mN": {"p50": 0.1, "p95": 0.3, "p99": 0.4},
    "limits_acted": [],
    "actions": [],
    "samples": 820,
    "missed_ticks": 0,
    "unanswered_ticks": 0,
    "dropped_messages": 0,
}
"""Members of closed-loop results in the examples."""


class MotionResult(ClosedLoopResult):
    """Result of a move, a hold or a release. A value is null if the job does not have it."""

    model_config = example(
        outcome="moved",
        phases=[{"phase": "move", "start_s": 0.4, "duration_s": 1.4}],
        **COMMON,
        begins_at={"x_um": 0.02, "voltage_V": 0.0},
        ends_at={"x_um": 12.51, "voltage_V": 0.64},
        teach="beside-the-bead",
        target_um=12.5,
        target_error_um=0.01,
        drift_um=None,
        held_at_end=False,
    )

    begins_at: Pose
    """Pose at the first sample."""
    ends_at: Pose
    """Mean position at the end of the job, while the arm rests, and the voltage that is kept."""
    teach: str | None
    """Name under which the pose was taught; a recipe can store it."""
    target_um: float | None
    target_error_um: float | None
    """Position minus the target."""
    drift_um: float | None
    """Peak-to-peak drift of the position while a part was held."""
    held_at_end: bool


ARMS = (("", "arm"), ("second_", "second arm"))
"""Prefixes of result members, each with the arm that these members describe."""


def confirmations(result: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the facts that confirm the values of a result or make them doubtful.

    Each fact is a short statement and a text with numbers or a remedy; the text may be empty.
    """
    goal = result.get("goal")
    if goal is not None:
        met: bool | None = goal["met"]
        yield {True: "goal met", False: "goal missed", None: "goal not judged"}[met], ""
    returns = [(arm, result.get(f"{prefix}zero_return")) for prefix, arm in ARMS]
    known = [(arm, each) for arm, each in returns if each is not None]
    failed = [(arm, each) for arm, each in known if not each["verified"]]
    for arm, each in failed:
        read = f"{each['force_mN']:.2f} ± {each['uncertainty_mN']:.2f} mN"
        yield (
            "force not verified by the zero return",
            f"back at the position of its zero, the {arm} read {read}",
        )
    if known and not failed:
        yield "force verified by the zero return", ""
    released = result.get("release")
    if released is not None and released["verdict"] == "sticks":
        yield "the part sticks to the arm", "try other strategies, or take it off by hand"
    if result.get("forces_agree") is False:
        yield "the forces of both arms differ", ""
    if result.get("zero_unconfirmed"):
        yield (
            "zero not confirmed",
            "a part that pressed while the force was zeroed would not be noticed; make sure "
            "that nothing touches the arm, then send zero_confirmed = true",
        )
    if result.get("zero_invalid"):
        yield (
            "zero invalid",
            "a held part read a pull: the part was removed, or the sensor jumped; the force is "
            "unknown from then on",
        )
    for prefix, arm in ARMS:
        change = result.get(f"{prefix}stroke_change_percent")
        limit = result.get(f"{prefix}stroke_limit_percent")
        if change is not None and limit is not None and abs(change) > limit:
            yield (
                f"the {arm} differs from its model",
                f"its stroke has changed by {change:+.2f} % since its calibration; up to "
                f"±{limit:.2f} % can be explained by noise",
            )
