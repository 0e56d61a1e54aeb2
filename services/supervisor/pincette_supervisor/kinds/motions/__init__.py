"""Kinds ``move``, ``hold``, ``release`` and ``carry``: jobs that load no new part."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.api import WHOLE, example
from pincette.api.job_kinds import FieldSpec, JobKind, choices, number
from pincette.api.pairs import PairJobRequest, PairPlan, PairResult
from pincette.api.plans import MotionPlan
from pincette.api.requests import (
    Duration,
    GoalRequest,
    JobRequest,
    PolicyRequest,
    Positive,
    Speed,
    ZeroingRequest,
    check_one_hold,
)
from pincette.api.results import COMMON, MotionResult
from pincette.control.vocabulary import ReleaseStrategy
from pincette_supervisor.kinds import fields

TARGETS = ("to_um", "by_um", "to_V", "by_V")
CYCLES_MAX = 20
POSE_NAME = r"^[A-Za-z0-9_.-]{1,40}$"


class MoveJobRequest(GoalRequest, ZeroingRequest, frozen=True):
    """Move the free arm, then keep the voltage constant.

    The law moves the arm to a position; a voltage is applied without a law. Cycles of voltage
    before the move can bring the hysteresis into a known state and warm up the arm.

    Exactly one of ``to_um``, ``by_um``, ``to_V`` and ``by_V`` is required.
    ``position_tolerance_um`` needs ``to_um`` or ``by_um``. ``force_tolerance_mN`` must be omitted,
    since a move has no force reference. ``low_V``, ``high_V`` and ``rate_V_per_s`` need
    ``conditioning_cycles`` or ``warm_up_s``.
    """

    model_config = example(kind="move", autostart=True, to_um=12.5, conditioning_cycles=3)

    kind: Literal["move"]
    to_um: float | None = None
    """Target position, reached by the law."""
    by_um: float | None = None
    """Signed distance of the target from that of the last move if the arm is still there, otherwise
    from the present position.
    """
    to_V: float | None = None
    """Target voltage, applied without a law."""
    by_V: float | None = None
    """Signed difference between the target voltage and the applied voltage."""
    speed_um_per_s: Speed | None = None
    """Peak speed; converted to V/s by the nominal gain for a voltage (default: the speed of the rig
    file's approach).
    """
    conditioning_cycles: Annotated[int, Field(ge=0, le=CYCLES_MAX), WHOLE] = 0
    """Full cycles of voltage before the move, each from ``low_V`` to ``high_V`` and back."""
    warm_up_s: Annotated[float, Field(ge=0, le=3600)] = 0.0
    """Duration of the cycles that warm up the arm, before the ``conditioning_cycles``."""
    low_V: float | None = None
    """Lowest voltage of the cycles, below ``high_V`` (default: as low as the rig file's limits
    permit)."""
    high_V: float | None = None
    """Highest voltage of the cycles (default: as high as the rig file's limits and its part
    permit)."""
    rate_V_per_s: Positive | None = None
    """Peak rate of the cycles."""
    zero: bool = True
    """Zero the force at the start, so that a contact during the motion is detected."""
    teach: Annotated[str, Field(pattern=POSE_NAME)] | None = None
    """Name under which the result states the pose that is reached."""

    @model_validator(mode="after")
    def _one_target(self) -> "MoveJobRequest":
        said = [name for name in TARGETS if getattr(self, name) is not None]
        if len(said) != 1:
            found = " and ".join(said) or "none"
            raise ValueError(f"a move needs exactly one of {', '.join(TARGETS)}; found {found}")
        if self.low_V is not None and self.high_V is not None and self.low_V >= self.high_V:
            raise ValueError(f"low_V = {self.low_V} V is not below high_V = {self.high_V} V")
        led = self.to_um is not None or self.by_um is not None
        if self.position_tolerance_um is not None and not led:
            raise ValueError(
                "position_tolerance_um is compared with the reference of the law, but a "
                "target voltage has no reference: give to_um or by_um"
            )
        if self.force_tolerance_mN is not None:
            raise ValueError("force_tolerance_mN: a move has no force reference; leave it out")
        cycled = self.conditioning_cycles or self.warm_up_s
        for name in ("low_V", "high_V", "rate_V_per_s"):
            if getattr(self, name) is not None and not cycled:
                raise ValueError(
                    f"{name} applies to cycles only: give conditioning_cycles or warm_up_s too"
                )
        return self


MOVE = JobKind(
    name="move",
    label="Move the free arm",
    summary="Move the free arm to a position or a voltage, and let it rest there.",
    request=MoveJobRequest,
    plan=MotionPlan,
    result=MotionResult,
    functions="pincette_supervisor.kinds.motions.functions:MOVE",
    form=(
        fields.ZERO_CONFIRMED,
        FieldSpec(
            name="target",
            label="Target",
            widget="choice",
            choices=choices(
                ("to_um", "to a position"),
                ("by_um", "by a distance"),
                ("to_V", "to a voltage"),
                ("by_V", "by a voltage"),
            ),
            names=True,
        ),
        FieldSpec(name="value", label="Value", widget="number", required=True, named_by="target"),
        FieldSpec(name="speed_um_per_s", label="Peak speed"),
        FieldSpec(
            name="position_tolerance_um",
            label="Position within",
            when={"target": ("to_um", "by_um")},
            advanced=True,
        ),
        fields.SETTLING.model_copy(update={"when": {"target": ("to_um", "by_um")}}),
        FieldSpec(name="conditioning_cycles", label="Conditioning cycles", placeholder="none"),
        FieldSpec(name="warm_up_s", label="Warm up for", placeholder="not"),
        FieldSpec(name="low_V", label="Cycles from", advanced=True),
        FieldSpec(name="high_V", label="Cycles to", advanced=True),
        FieldSpec(name="rate_V_per_s", label="Cycles at", advanced=True),
    ),
    figures=fields.MOTION,
    brief={
        "ends_at.x_um": "rests at",
        "target_um": "target",
        "target_error_um": "target error",
        "ends_at.voltage_V": "final voltage",
        "teach": "taught as",
    },
    from_present=True,
    predicted=True,
    goal_phase="rest",
    relative=("by_um", "by_V"),
    jogs=True,
    place=30,
)


class HoldJobRequest(PolicyRequest, frozen=True):
    """Keep holding the part in the gripper, and release it at the end.

    The part must be held when the job begins: by a running or an ended job, or since a trip that
    was reset. Without ``force_mN`` the applied voltage does not change, so neither a law nor a zero
    is needed; the position limits are monitored. With ``force_mN`` the law loads or unloads the
    part to that force.
    """

    model_config = example(kind="hold", autostart=True, until_released=True)

    kind: Literal["hold"]
    force_mN: Positive | None = None
    """Force to which the held part is loaded or unloaded. None: the voltage does not change."""
    load_s: Duration | None = None
    """Duration of the change to ``force_mN``, only together with it (default: that of the load of
    a grip)."""
    hold_s: Duration | None = None
    """Duration of the hold (default: until the action ``release``)."""
    until_released: bool = False
    """Hold until the action ``release``, which is also the default; excludes ``hold_s``."""
    release_s: Duration | None = None
    """Duration of the motion to the safe voltage (default: as in a release)."""

    @model_validator(mode="after")
    def _way_to_a_force(self) -> "HoldJobRequest":
        if self.load_s is not None and self.force_mN is None:
            raise ValueError(
                f"load_s = {self.load_s} s is the time to reach force_mN, which is not given"
            )
        return self

    @model_validator(mode="after")
    def _one_hold(self) -> "HoldJobRequest":
        check_one_hold(self.hold_s, until_released=self.until_released)
        return self


class HoldResult(MotionResult):
    """Results of a hold; those of the force are null if the request has no force."""

    model_config = example(
        outcome="released",
        phases=[{"phase": "hold", "start_s": 2.0, "duration_s": 4.0}],
        **COMMON,
        begins_at={"x_um": 34.1, "voltage_V": 1.92},
        ends_at={"x_um": 0.1, "voltage_V": 0.0},
        teach=None,
        target_um=None,
        target_error_um=None,
        drift_um=0.05,
        held_at_end=False,
        force_target_mN=15.0,
        force_held_mN=15.01,
        force_error_mN=0.01,
    )

    force_target_mN: float | None = None
    force_held_mN: float | None = None
    """Mean of the estimated force over the hold without its first half second."""
    force_error_mN: float | None = None
    """Mean of the estimate minus F_r over the hold without its first half second."""


HOLD = JobKind(
    name="hold",
    label="Hold a part",
    summary="Continue to hold what is in the gripper, as it is or with another force.",
    request=HoldJobRequest,
    plan=MotionPlan,
    pair_plan=PairPlan,
    result=HoldResult,
    pair_result=PairResult,
    functions="pincette_supervisor.kinds.motions.hold:FUNCTIONS",
    form=(
        FieldSpec(name="force_mN", label="Force", limit="force_max", placeholder="as it is"),
        FieldSpec(name="load_s", label="Load over", advanced=True),
        FieldSpec(name="hold_s", label="Hold", placeholder="until released"),
        fields.RELEASE,
        *fields.POLICIES,
    ),
    figures=(
        *fields.for_arms(
            1,
            *fields.MOTION,
            *fields.RELEASE_VERDICT,
            number(
                "force_held_mN",
                "force held",
                uncertainty="force_uncertainty_mN",
                assumed="force_assumed",
                optional=True,
            ),
            number("force_target_mN", "requested force", optional=True),
            number("force_error_mN", "force error", optional=True),
            number("peak_force_mN", "peak force", optional=True),
        ),
        *fields.for_arms(2, *fields.PAIR_FIGURES),
    ),
    brief={
        "force_held_mN": "force held",
        "force_target_mN": "requested force",
        "peak_force_mN": "peak force",
        "drift_um": "drift while held",
        "held_place_um": "place",
        "difference_mN": "difference of both forces",
        "release.verdict": "release",
    },
    begins_held=True,
    from_present=True,
    arms=(1, 2),
    place=40,
)


class ReleaseJobRequest(JobRequest, frozen=True):
    """Release the part in the gripper by a smooth motion from the applied to the safe voltage.

    With strategies, one after the other is tried until the arm moves like a free arm, which ends
    the job. If the part still sticks after the last strategy, the job fails. The part counts as
    held until the job ends, so a fault before that first freezes the voltage.
    """

    model_config = example(kind="release", autostart=True, strategies=["retreat", "dither"])

    kind: Literal["release"]
    release_s: Duration | None = None
    """Duration of the release (default: as long as a grip takes to unload, or as the slew limit
    requires; with strategies at most at the speed of the rig file's approach)."""
    strategies: list[ReleaseStrategy] | None = Field(default=None, min_length=1, max_length=4)
    """Strategies, in order: a slow ``retreat``, a ``fast`` one, ``dither`` about the safe voltage,
    ``wait`` there while the part is pulled. ``dither`` and ``wait`` may be named once."""
    dither_um: Annotated[float, Field(gt=0, le=10)] | None = None
    """Amplitude of the dither, only for the strategy ``dither``, in µm of the free arm (default:
    1 µm)."""
    dither_hz: Annotated[float, Field(gt=0, le=1000)] | None = None
    """Frequency of the dither, only for the strategy ``dither``, at most a fifth of the sampling
    rate (default: 5 Hz)."""
    dither_s: Annotated[float, Field(gt=0, le=600)] | None = None
    """Duration of the dither at full amplitude, only for the strategy ``dither`` (default: 2 s)."""
    wait_s: Annotated[float, Field(gt=0, le=3600)] | None = None
    """Duration of the wait, only for the strategy ``wait`` (default: 10 s)."""

    @model_validator(mode="after")
    def _of_a_strategy(self) -> "ReleaseJobRequest":
        tried = self.strategies or []
        for strategy in ("dither", "wait"):
            if tried.count(strategy) > 1:
                raise ValueError(f"strategies: {strategy} is named twice; name it once")
        for name in ("dither_um", "dither_hz", "dither_s", "wait_s"):
            strategy = name.partition("_")[0]
            if getattr(self, name) is not None and strategy not in tried:
                raise ValueError(
                    f"{name} belongs to the strategy {strategy}: name it in strategies"
                )
        return self


RELEASE = JobKind(
    name="release",
    label="Release a part",
    summary="Release what is in the gripper.",
    request=ReleaseJobRequest,
    plan=MotionPlan,
    result=MotionResult,
    functions="pincette_supervisor.kinds.motions.functions:RELEASE",
    form=(
        fields.RELEASE,
        FieldSpec(name="strategies", label="Strategies", placeholder="one smooth way back"),
        FieldSpec(name="dither_um", label="Dither by", placeholder="1", advanced=True),
        FieldSpec(name="dither_hz", label="Dither at", placeholder="5", advanced=True),
        FieldSpec(name="dither_s", label="Dither for", placeholder="2", advanced=True),
        FieldSpec(name="wait_s", label="Wait for", placeholder="10", advanced=True),
    ),
    figures=(*fields.RELEASE_VERDICT, *fields.MOTION),
    brief={
        "release.verdict": "release",
        "release.pull_off_mN": "pull-off force",
        "release.stiffness_mN_per_um": "remaining stiffness",
        "ends_at.x_um": "rests at",
    },
    begins_held=True,
    from_present=True,
    arms=(1, 2),
    place=50,
)


class CarryJobRequest(PairJobRequest, frozen=True):
    """Carry a held part to another place and keep holding it.

    The part must be held by a job that has ended. The force is unknown without a zero; the law
    keeps it constant. Exactly one of ``by_um`` and ``to_um`` is required.
    """

    model_config = example(kind="carry", autostart=True, by_um=5.0)

    kind: Literal["carry"]
    by_um: float | None = None
    """Signed distance of the carry, positive towards the second arm."""
    to_um: float | None = None
    """Target place q = (x_1 - x_2)/2; the carry starts where both tips are when the job is
    planned."""

    @model_validator(mode="after")
    def _one_target(self) -> "CarryJobRequest":
        if (self.by_um is None) == (self.to_um is None):
            raise ValueError("a carry needs exactly one of by_um, to_um")
        return self


CARRY = JobKind(
    name="carry",
    label="Move a held part",
    summary="Move a part that both arms hold, and keep holding it.",
    request=CarryJobRequest,
    plan=PairPlan,
    result=PairResult,
    figures_in_prediction=True,
    functions="pincette_supervisor.kinds.pairs:CARRY",
    form=(
        FieldSpec(name="by_um", label="By"),
        FieldSpec(name="to_um", label="To the place", placeholder="by a distance"),
        *fields.PAIR_LAW,
        *fields.POLICIES,
    ),
    figures=fields.PAIR_FIGURES,
    brief={
        "force_held_mN": "force held",
        "peak_force_mN": "peak force",
        "held_place_um": "place",
        "difference_mN": "difference of both forces",
    },
    begins_held=True,
    from_present=True,
    relative=("by_um",),
    arms=(2,),
    place=35,
)
