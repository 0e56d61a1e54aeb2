"""Results of jobs, as they are stored and sent."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from pincette.api import Model, example
from pincette.api.places import PlaceFound
from pincette.api.plans import Pose
from pincette.api.states import ActionType


class Phase(Model):
    """A phase as it was played."""

    model_config = example(phase="hold", start_s=8.9, duration_s=4.0)

    phase: str
    start_s: float
    duration_s: float


class Percentiles(Model):
    """Percentiles of a magnitude, in the unit of its name."""

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
    """Errors over a hold or a path: actual value minus reference, in the member's unit."""

    model_config = example(rmse=0.087, rmse_percent=0.95, maximum=0.29)

    rmse: float
    rmse_percent: float | None
    """Root mean square error relative to the reference's peak-to-peak range; null if the reference
    rests."""
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
    """An error by cause; each part is a root mean square in the unit of the parent's name.

    The squares can be added; where two causes cancel in part, the total is smaller.
    """

    model_config = example(**CAUSES)

    total: float
    """Total error: of the measured position, or of the true force as expected."""
    noise: float
    """Part that repeats in no cycle; for the force, the contribution of the resulting motion of the
    arm."""
    response: float
    """Error of the model of the free arm; for the force, as the estimator states it."""
    contact_line: float
    """Deviation of estimate and position from the contact line of the references."""
    lag: float
    """Part that is proportional to speed and acceleration of the reference."""
    limits: float
    """Part from samples at which a limit of the voltage was active, and just after."""
    largest: Literal["noise", "response", "contact_line", "lag", "limits"]
    to_do: str
    """Change that would reduce the largest contribution."""


class ErrorSources(Model):
    """Causes of the errors in a hold or on a path."""

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
    settling time, so that the goal is not judged."""
    settling_s: float
    """Time, from the beginning of the hold, path or rest, by which every error should have settled.
    """
    settled_s: float | None
    """Time from which every error stays within its tolerance, counted from the same beginning; null
    if there is none or the job did not reach that phase."""
    position_tolerance_um: float | None
    position_error_um: float | None
    """Largest magnitude of x minus x_r after the settling time; null if there is none."""
    force_tolerance_mN: float | None
    force_error_mN: float | None
    """Largest magnitude of the estimate minus F_r after the settling time."""


class ZeroReturn(Model):
    """Estimated force when the arm, free again, returns to the place of its zero.

    It is 0 except for the error of the free response. Drift or a jump of the sensor, an unnoticed
    slip, or a large change of a gain shows in it.
    """

    model_config = example(force_mN=-0.11, uncertainty_mN=0.42, x_um=26.0, verified=True)

    force_mN: float
    """Mean estimate over the samples around the place of the zero, while the arm returns."""
    uncertainty_mN: float
    """Expanded uncertainty, from the returns of rehearsed grips, or from the estimator if the model
    has none."""
    x_um: float
    """Place of the zero."""
    verified: bool
    """False if the force exceeds its uncertainty: no force since that zero is then verified."""


class ReleaseVerdict(Model):
    """Verdict on the release of a part, from the motion of the arm on its way back.

    An arm that a part holds moves less than a free one, whether the part is pressed or pulled. A
    part that comes along on the arm alone pulls on nothing: only a camera sees it.
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
    """``released`` if the arm moves as a free one, ``sticks`` if it moves as one that the part
    holds, ``unknown`` if the uncertainty admits both or neither, or if a free arm is pulled."""
    strategies: list[str]
    """Strategies that were tried, in order; empty for a release without."""
    stiffness_mN_per_um: float | None
    """Stiffness that holds the arm at the end of the way back; about 0 for a free arm; null if the
    way back is too short."""
    stiffness_uncertainty_mN_per_um: float | None
    """Expanded uncertainty of that stiffness."""
    pull_off_mN: float | None
    """Pull that ended as the part came off; 0 if noise and speed hide it; null if it has not. A
    bridge of liquid may pull on a little longer."""
    pull_off_uncertainty_mN: float | None
    """Expanded uncertainty of the pull-off force; a slow way back makes it small."""


StepCause = Literal["slip", "sensor", "unknown"]


class PositionStep(Model):
    """A step of the position of a pressed part that the voltage does not explain.

    At constant voltage one arm and one sensor cannot distinguish a part that slips from a sensor
    that jumps towards the part: the force is ``force_if_slip_mN`` or ``force_if_sensor_mN`` then.
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
    """``slip`` of the part; ``sensor``, or a push; ``unknown`` where neither the direction of the
    step nor the force that the free arm reads afterwards decides."""
    at_s: float
    """Time at which the step was confirmed."""
    x_um: float
    """Position just before the step."""
    step_um: float
    """Step of the position, positive towards the part; the sum if there were several."""
    slip_um: float | None
    """Distance by which the part slipped, if a slip is possible and its stiffness is known."""
    slips: int
    """Number of slips of the part in a load."""
    force_mN: float
    """Estimated force just before the step."""
    force_if_slip_mN: float | None
    """Force just after the step, if the part slipped; null if a slip is impossible."""
    force_if_sensor_mN: float | None
    """Force just after the step, if the sensor jumped; null if the part certainly slipped."""
    rang: bool | None = None
    """Hint: true if the pressed arm rang after the step, as it does after a slip but not after a
    sensor jump. False proves nothing, since friction may damp a slip. Null if the voltage moved at
    that time."""


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
    """End of the program as the controller reported it; ``tripped`` if the actuator reported a
    trip; ``unfinished`` if neither reported an end."""
    phases: list[Phase]
    limits_acted: list[LimitActed]
    actions: list[ActionTaken]
    samples: int
    missed_ticks: int
    """Number of samples that were never taken or never arrived."""
    unanswered_ticks: int
    """Number of ticks for which the actuator accepted no command."""
    dropped_messages: int
    touch_x_um: float | None = None
    """Position at which the arm met something during its motion through free space."""
    touch_force_mN: float | None = None
    """Force at that touch when the arm turned back, from the free response or from the slope of its
    way."""
    position_step: PositionStep | None = None
    """Step of the position that the voltage does not explain; null if there was none."""
    goal: Goal | None = None
    """Comparison of the errors with the tolerances; null if the request has none."""
    place: PlaceFound | None = None
    """Comparison of the place where the part was met with the one that was given; null if none was
    given."""


class LoadForces(Model):
    """Smallest and largest estimated force of a load."""

    model_config = example(lowest_mN=2.1, highest_mN=20.1)

    lowest_mN: float
    highest_mN: float


class ClosedLoopResult(JobResult):
    """Result of a job under a control law. A value is null if the job did not reach that phase."""

    contact_load: LoadForces | None = None
    """Forces over which stiffness and place of the contact are means; null without a load. A round
    face is softer at smaller and stiffer at larger forces, and is touched slightly before that
    place."""
    contact_x_um: float | None
    contact_x_error_um: float | None
    """Standard error of the place, from the load's deviation from a straight line and the force's
    own error."""
    contact_stiffness_mN_per_um: float | None
    contact_stiffness_error_mN_per_um: float | None
    """Standard error of the stiffness, from the load's deviation from a straight line."""
    force_uncertainty_mN: float | None
    """Uncertainty of the mean force of a grip's hold, in which noise is averaged; otherwise of
    single samples, as a mean over the path."""
    force_assumed: list[str]
    """Quantities on which the uncertainty is based and that no calibration has found."""
    zero_age_s: float | None
    """Age of the zero at the end of the hold or the path."""
    stroke_change_percent: float | None = None
    """Change of the arm's stroke since its calibration, from the way that began with conditioning
    strokes; null if the arm has not been conditioned since the estimator started."""
    stroke_limit_percent: float | None = None
    """Largest change of the stroke that noise and repetition explain; the force is corrected beyond
    it."""
    model_mismatch: bool = False
    """True if noise and repetition do not explain the change of the stroke."""
    zero_unconfirmed: bool = False
    """True if only the zero itself shows that no part pressed when it was taken: all forces may
    then be too small by the hidden one. A part found at its planned place, or ``zero_confirmed``,
    also shows it."""
    peak_force_mN: float | None
    final_force_mN: float | None
    zero_return: ZeroReturn | None = None
    """Zero return; null if the arm did not come back free to the place of a zero of this job."""
    release: ReleaseVerdict | None = None
    """Verdict on the release at the end of the job; null if it released no part."""
    contact_rmse_position_um: float | None
    """Root mean square position error from the load to the unload."""
    contact_rmse_force_mN: float | None
    """Root mean square force error from the load to the unload."""
    sliding_um: Percentiles | None
    """Percentiles of |s| over all samples, as are the members down to
    ``true_perturbation_error_mN``. With K_S = 0 nothing returns s: it follows the perturbation and
    moves no voltage."""
    sliding_in_band: float | None
    """Share of samples with |s| within its band, outside of which |s| cannot have grown."""
    residual_um: Percentiles | None
    """Magnitude of x minus its prediction (17), with the law's own force."""
    law_perturbation_mN: Percentiles | None
    """Magnitude of p̂ (6), with the law's own force and parameter set."""
    perturbation_error_mN: Percentiles | None
    """Magnitude of p̃ (8) with the law's own force and parameter set; K_S would have to exceed it.
    If the force is estimated from the same position and voltage, two models are compared."""
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
    """Result of a move, a hold or a release. A value is null if the job has none."""

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
    """Mean position over the last rest, and the voltage that is kept."""
    teach: str | None
    """Name under which the pose is taught, to be stored in a recipe."""
    target_um: float | None
    target_error_um: float | None
    """Position minus the target."""
    drift_um: float | None
    """Peak-to-peak drift of the position while a part was held."""
    held_at_end: bool


ARMS = (("", "arm"), ("second_", "second arm"))
"""Prefixes of the names of figures, each with the arm that the figures describe."""


def confirmations(result: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the facts that confirm the figures of a result or make them doubtful.

    Each fact is a short statement and a text with numbers or a remedy, which may be empty.
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
    for prefix, arm in ARMS:
        change = result.get(f"{prefix}stroke_change_percent")
        limit = result.get(f"{prefix}stroke_limit_percent")
        if change is not None and limit is not None and abs(change) > limit:
            yield (
                f"the {arm} differs from its model",
                f"its stroke has changed by {change:+.2f} % since its calibration; up to "
                f"±{limit:.2f} % can be explained by noise",
            )
