"""What comes of a job, as it is stored and sent."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from pincette.api import Model, example
from pincette.api.plans import Pose
from pincette.api.states import ActionType


class Phase(Model):
    """A phase as it went."""

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
    """A limit of the actuator that acted."""

    model_config = example(limit="slew_up", first_seq=344, samples=3)

    limit: str
    first_seq: int
    samples: int


class ActionTaken(Model):
    """An action and the sample at which it took effect."""

    model_config = example(type="release", seq=611)

    type: ActionType
    seq: int


CAUSES: dict[str, Any] = {
    "total": 0.039,
    "noise": 0.036,
    "response": 0.004,
    "contact_line": 0.011,
    "lag": 0.006,
    "limits": 0.0,
    "largest": "noise",
    "to_do": "the sensor's noise is the floor: a better sensor alone goes below it",
}


class ErrorCauses(Model):
    """An error by its causes, each an r.m.s. in the unit of the name above.

    Their squares can be added up; where two causes cancel in part the whole is less.
    """

    model_config = example(**CAUSES)

    total: float
    """Of the position as measured; of the true force as it is to be expected."""
    noise: float
    """What comes back in no cycle; of the force what the arm moves by it."""
    response: float
    """What the model of the free arm misses; of the force as the estimator states it."""
    contact_line: float
    """Estimate and position are off the contact line of the references."""
    lag: float
    """What goes with speed and acceleration of the reference."""
    limits: float
    """Samples at which a limit of the voltage acted, and those just after."""
    largest: Literal["noise", "response", "contact_line", "lag", "limits"]
    to_do: str
    """What helps against the largest."""


class ErrorSources(Model):
    """Where the errors of a hold or a path come from."""

    model_config = example(position_um=CAUSES, force_mN=CAUSES)

    position_um: ErrorCauses
    force_mN: ErrorCauses


class Goal(Model):
    """Whether a job came as near to its references as it was to, and when."""

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
    """Whether the errors stayed within their tolerances; null where the phase was not longer than
    the settling time, so that it is not judged."""
    settling_s: float
    """Time in which it was to settle, from the begin of hold, path or rest."""
    settled_s: float | None
    """Time from which on every error stays within its tolerance, from the same begin; null: none,
    or the job did not come that far."""
    position_tolerance_um: float | None
    position_error_um: float | None
    """Largest magnitude of x less x_r after the settling time; null where there is none."""
    force_tolerance_mN: float | None
    force_error_mN: float | None
    """Largest magnitude of the estimate less F_r after the settling time."""


class ZeroReturn(Model):
    """What the force reads as the arm, free again, comes back to the place of its zero.

    It is 0 but for the error of the free response. Drift or a jump of the sensor, a slip that was
    not noticed, or a large change of a gain shows in it.
    """

    model_config = example(force_mN=-0.11, uncertainty_mN=0.42, x_um=26.0, verified=True)

    force_mN: float
    """Mean of the estimate over the samples about the place of the zero, on the way back."""
    uncertainty_mN: float
    """Expanded uncertainty: by the ways back of rehearsed grips, or as the estimator states it
    where the model has none."""
    x_um: float
    """Place of the zero."""
    verified: bool
    """False where the force is beyond its uncertainty: no force since that zero is verified."""


StepCause = Literal["slip", "sensor", "unknown"]


class PositionStep(Model):
    """A step of the position of a pressed part that the voltage does not explain.

    At constant voltage one arm and one sensor cannot tell a part that slips from a sensor that
    jumps towards the part: the force is ``force_if_slip_mN`` or ``force_if_sensor_mN`` then.
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
    """Time at which it was confirmed."""
    x_um: float
    """Position just before it."""
    step_um: float
    """Step of the position, positive towards the part; of several, their sum."""
    slip_um: float | None
    """Way by which the part gave way, where a slip can be the cause and its stiffness is known."""
    slips: int
    """Number of times that the part gave way in a load."""
    force_mN: float
    """Estimated force just before it."""
    force_if_slip_mN: float | None
    """Force just after it, if the part slipped; null where a slip cannot be the cause."""
    force_if_sensor_mN: float | None
    """Force just after it, if the sensor jumped; null where the part slipped for certain."""
    rang: bool | None = None
    """Hint: whether the pressed arm rang after the step, as it does after a slip; no sensor rings.
    False proves nothing, since friction may damp a slip. Null where the voltage moved then."""


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
    """What every result has."""

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
    """How the program ended, by the controller; ``tripped`` by the actuator, ``unfinished`` where
    nobody said."""
    phases: list[Phase]
    limits_acted: list[LimitActed]
    actions: list[ActionTaken]
    samples: int
    missed_ticks: int
    """Samples that were never taken or never came here."""
    unanswered_ticks: int
    """Ticks for which the actuator took no command."""
    dropped_messages: int
    touch_x_um: float | None = None
    """Where the arm met something on its way through free space."""
    touch_force_mN: float | None = None
    """With which force, as it turned back: by the free response, or by the slope of its way."""
    position_step: PositionStep | None = None
    """Null where every step of the position was explained by the voltage."""
    goal: Goal | None = None
    """Null where no tolerance was asked for."""


class LoadForces(Model):
    """Lowest and highest estimated force of a load."""

    model_config = example(lowest_mN=2.1, highest_mN=20.1)

    lowest_mN: float
    highest_mN: float


class ClosedLoopResult(JobResult):
    """Figures of a job under a law; a figure is null where the job did not come that far."""

    contact_load: LoadForces | None = None
    """Forces over which stiffness and place of the contact are means: a round face is softer below
    and harder above, and is touched a little before that place. Null without a load."""
    contact_x_um: float | None
    contact_x_error_um: float | None
    """Its standard error, by what the load leaves of a straight line and by the force's own."""
    contact_stiffness_mN_per_um: float | None
    contact_stiffness_error_mN_per_um: float | None
    """Its standard error, by what the load leaves of a straight line."""
    force_uncertainty_mN: float | None
    """Of the mean force that a grip has held, in which noise is averaged; else that of single
    samples, as a mean over the path."""
    force_assumed: list[str]
    """Quantities that it is worked out from and no calibration has found."""
    zero_age_s: float | None
    """At the end of the hold or the path."""
    stroke_change_percent: float | None = None
    """Change of the arm's stroke since its calibration, from the way that began with conditioning
    strokes; null where the arm was never conditioned since the estimator's start."""
    stroke_limit_percent: float | None = None
    """Change up to which noise and repetition explain it; the force is corrected beyond it."""
    model_mismatch: bool = False
    """True where noise and repetition do not explain the change of the stroke."""
    zero_unconfirmed: bool = False
    """True where nothing but the zero itself shows that no part pressed as it was taken: all forces
    may lack what it hides. A part found at its planned place shows it, or ``zero_confirmed``."""
    peak_force_mN: float | None
    final_force_mN: float | None
    zero_return: ZeroReturn | None = None
    """Null where the arm did not come back free to the place of a zero of this job."""
    contact_rmse_position_um: float | None
    """From the load to the unload."""
    contact_rmse_force_mN: float | None
    """From the load to the unload."""
    sliding_um: Percentiles | None
    """Of |s|, over all samples as the figures down to ``true_perturbation_error_mN`` are. Where
    K_S = 0 nothing brings s back: it goes with the perturbation, and moves no voltage."""
    sliding_in_band: float | None
    """Share of the samples with |s| within its band, outside which |s| cannot have grown."""
    residual_um: Percentiles | None
    """Of the magnitude of x less its prediction (17), by the law's own force."""
    law_perturbation_mN: Percentiles | None
    """Of |p̂| (6), by the law's own force and its parameter set."""
    perturbation_error_mN: Percentiles | None
    """Of |p̃| (8), likewise: what K_S would have to exceed. Where the force is estimated from the
    same position and voltage, model is held against model."""
    true_perturbation_error_mN: Percentiles | None
    """Of |p̃| (8) from position as measured, voltage as applied and the true force, by the law's
    parameter set; known to a simulated rig alone, null on a real one."""


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
"""Part of the examples."""


class MotionResult(ClosedLoopResult):
    """Figures of a move, a hold or a release; a figure is null where the job has none."""

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
    """At the first sample."""
    ends_at: Pose
    """Mean position over the last rest, and the voltage that is kept."""
    teach: str | None
    """Name that the pose was to be stated under, for a recipe to store."""
    target_um: float | None
    target_error_um: float | None
    """Position less target."""
    drift_um: float | None
    """Of the position while a part was held, peak to peak."""
    held_at_end: bool


ARMS = (("", "arm"), ("second_", "second arm"))
"""What names of figures begin with, and the arm that they are of."""


def confirmations(result: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what confirms the figures of a result or makes them doubtful.

    Each is stated in few words, and then with numbers or what to do; that may be empty.
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
            f"back at the place of its zero the {arm} read {read}",
        )
    if known and not failed:
        yield "force verified by the zero return", ""
    if result.get("forces_agree") is False:
        yield "the forces of both arms differ", ""
    if result.get("zero_unconfirmed"):
        yield (
            "zero not confirmed",
            "a part that pressed as the force was zeroed would be hidden; see that nothing touches "
            "the arm, then send zero_confirmed = true",
        )
    for prefix, arm in ARMS:
        change = result.get(f"{prefix}stroke_change_percent")
        limit = result.get(f"{prefix}stroke_limit_percent")
        if change is not None and limit is not None and abs(change) > limit:
            yield (
                f"the {arm} differs from its model",
                f"its stroke has changed by {change:+.2f} % since its calibration, explained are "
                f"±{limit:.2f} %",
            )
