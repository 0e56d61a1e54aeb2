"""Requests that move the free arm, or keep or let go what is in the gripper."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pincette.api.job_models import example
from pincette.api.request_base import Duration, PolicyRequest, Positive, Speed, StartRequest

TARGETS = ("to_um", "by_um", "to_V", "by_V")
CYCLES_MAX = 20
POSE_NAME = r"^[A-Za-z0-9_.-]{1,40}$"


class MoveJobRequest(StartRequest):
    """Move the free arm, and let it rest there; the voltage is kept.

    A position is gone to by the law, a voltage without one. Before that the hysteresis may be
    brought into a known state, and the arm be warmed up, by cycles of voltage.
    """

    model_config = example(kind="move", autostart=True, to_um=12.5, conditioning_cycles=3)

    kind: Literal["move"]
    to_um: float | None = None
    by_um: float | None = None
    """From where the arm stands as the job is planned."""
    to_V: float | None = None
    by_V: float | None = None
    """From the voltage that is applied."""
    speed_um_per_s: Speed | None = None
    """Peak speed; left out, that of the rig file's approach. Of a voltage, by the nominal gain."""
    conditioning_cycles: int = Field(default=0, ge=0, le=CYCLES_MAX)
    """Full cycles of voltage before the move, each from ``low_V`` to ``high_V`` and back."""
    warm_up_s: Annotated[float, Field(ge=0, le=3600)] = 0.0
    """How long the arm is cycled before that."""
    low_V: float | None = None
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
            raise ValueError(f"a move wants exactly one of {', '.join(TARGETS)}; there is {found}")
        if self.low_V is not None and self.high_V is not None and self.low_V >= self.high_V:
            raise ValueError(f"low_V = {self.low_V} V is not below high_V = {self.high_V} V")
        cycled = self.conditioning_cycles or self.warm_up_s
        for name in ("low_V", "high_V", "rate_V_per_s"):
            if getattr(self, name) is not None and not cycled:
                raise ValueError(
                    f"{name} belongs to the cycles: ask for conditioning_cycles or warm_up_s too"
                )
        return self


class HoldJobRequest(PolicyRequest):
    """Keep what is in the gripper by the voltage that is applied, and let it go at the end.

    For a part that is held when the job begins: after a trip and a reset, or after a stop. No law
    and no zero is needed; the limits of position are watched.
    """

    model_config = example(kind="hold", autostart=True, until_released=True)

    kind: Literal["hold"]
    hold_s: Duration | None = None
    """Left out: until the action ``release``."""
    until_released: bool = False
    """The same as no ``hold_s``; excludes it."""
    release_s: Duration | None = None
    """How long the way to the safe voltage takes; left out, as in a release."""

    @model_validator(mode="after")
    def _one_hold(self) -> "HoldJobRequest":
        if self.until_released and self.hold_s is not None:
            raise ValueError(
                f"hold_s = {self.hold_s} s and until_released = true exclude each other: "
                "leave one out"
            )
        return self


class ReleaseJobRequest(StartRequest):
    """Let go what is in the gripper: a smooth way from the voltage applied to the safe voltage.

    Until its end the part counts as held: a fault on the way freezes the voltage first.
    """

    model_config = example(kind="release", autostart=True, release_s=2.0)

    kind: Literal["release"]
    release_s: Duration | None = None
    """Left out, as long as a grip takes to unload, or as the slew limit asks for."""


AnyMotionRequest = MoveJobRequest | HoldJobRequest | ReleaseJobRequest
