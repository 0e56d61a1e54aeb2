"""``move``: move the free arm to a position or a voltage."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.api import WHOLE, example
from pincette.api.job_kinds import FieldSpec, JobKind, choices
from pincette.api.plans import MotionPlan
from pincette.api.requests import GoalRequest, Positive, Speed, ZeroingRequest
from pincette.api.results import MotionResult
from pincette_supervisor.kinds import fields

TARGETS = ("to_um", "by_um", "to_V", "by_V")
CYCLES_MAX = 20
POSE_NAME = r"^[A-Za-z0-9_.-]{1,40}$"


class MoveJobRequest(GoalRequest, ZeroingRequest, frozen=True):
    """Move the free arm, and let it rest there; the voltage is kept.

    A position is gone to by the law, a voltage without one. Before that the hysteresis may be
    brought into a known state, and the arm be warmed up, by cycles of voltage.
    """

    model_config = example(kind="move", autostart=True, to_um=12.5, conditioning_cycles=3)

    kind: Literal["move"]
    to_um: float | None = None
    """Target position, by the law."""
    by_um: float | None = None
    """From the target of the last move where the arm still stands there, else from its position."""
    to_V: float | None = None
    """Target voltage, without a law."""
    by_V: float | None = None
    """From the voltage that is applied."""
    speed_um_per_s: Speed | None = None
    """Peak speed; left out, that of the rig file's approach. Of a voltage, by the nominal gain."""
    conditioning_cycles: Annotated[int, Field(ge=0, le=CYCLES_MAX), WHOLE] = 0
    """Full cycles of voltage before the move, each from ``low_V`` to ``high_V`` and back."""
    warm_up_s: Annotated[float, Field(ge=0, le=3600)] = 0.0
    """Time for which the arm is cycled before that."""
    low_V: float | None = None
    """Lowest voltage of the cycles, or of a grip."""
    high_V: float | None = None
    """Of the cycles; left out, as far as the rig file's limits and its part allow."""
    rate_V_per_s: Positive | None = None
    """Peak rate of the cycles."""
    zero: bool = True
    """Zero the force where the arm stands, so that a contact on the way is noticed."""
    teach: Annotated[str, Field(pattern=POSE_NAME)] | None = None
    """Name under which the result states the pose that is reached."""

    @model_validator(mode="after")
    def _one_target(self) -> "MoveJobRequest":
        said = [name for name in TARGETS if getattr(self, name) is not None]
        if len(said) != 1:
            found = " and ".join(said) or "none"
            raise ValueError(f"a move needs exactly one of {', '.join(TARGETS)}; there is {found}")
        if self.low_V is not None and self.high_V is not None and self.low_V >= self.high_V:
            raise ValueError(f"low_V = {self.low_V} V is not below high_V = {self.high_V} V")
        led = self.to_um is not None or self.by_um is not None
        if self.position_tolerance_um is not None and not led:
            raise ValueError(
                "position_tolerance_um is compared with the reference of the law, and a "
                "target voltage has none: give to_um or by_um"
            )
        if self.force_tolerance_mN is not None:
            raise ValueError("force_tolerance_mN: a move has no force reference; leave it out")
        cycled = self.conditioning_cycles or self.warm_up_s
        for name in ("low_V", "high_V", "rate_V_per_s"):
            if getattr(self, name) is not None and not cycled:
                raise ValueError(
                    f"{name} belongs to the cycles: ask for conditioning_cycles or warm_up_s too"
                )
        return self


KIND = JobKind(
    name="move",
    label="Move the free arm",
    summary="Move the free arm to a position or a voltage, and let it rest there.",
    request=MoveJobRequest,
    plan=MotionPlan,
    result=MotionResult,
    functions="pincette_supervisor.kinds.move.functions:FUNCTIONS",
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
    from_present=True,
    predicted=True,
    goal_phase="rest",
    relative=("by_um", "by_V"),
    jogs=True,
    place=30,
)
