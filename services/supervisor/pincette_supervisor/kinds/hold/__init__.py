"""``hold``: keep what is in the gripper, as it is or with a new force, and let it go at the end."""

from typing import Literal

from pydantic import model_validator

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, JobKind, number
from pincette.api.pairs import PairPlan, PairResult
from pincette.api.plans import MotionPlan
from pincette.api.requests import Duration, PolicyRequest, Positive, check_one_hold
from pincette.api.results import COMMON, MotionResult
from pincette_supervisor.kinds import fields


class HoldJobRequest(PolicyRequest, frozen=True):
    """Keep what is in the gripper, and let it go at the end.

    For a part that is held when the job begins: in or after another job, or after a trip and a
    reset. Without ``force_mN`` the voltage stays as it is applied: no law and no zero is needed,
    and the limits of position are watched. With it the law loads or unloads the part to that force.
    """

    model_config = example(kind="hold", autostart=True, until_released=True)

    kind: Literal["hold"]
    force_mN: Positive | None = None
    """Force to load or unload the held part to. None: the voltage stays as it is."""
    load_s: Duration | None = None
    """Time of the way to ``force_mN``; left out, as long as a grip loads."""
    hold_s: Duration | None = None
    """Left out: until the action ``release``."""
    until_released: bool = False
    """Whether to hold without an end, as without ``hold_s``, which it excludes."""
    release_s: Duration | None = None
    """How long the way to the safe voltage takes; left out, as in a release."""

    @model_validator(mode="after")
    def _way_to_a_force(self) -> "HoldJobRequest":
        if self.load_s is not None and self.force_mN is None:
            raise ValueError(f"load_s = {self.load_s} s is the way to force_mN, which is not given")
        return self

    @model_validator(mode="after")
    def _one_hold(self) -> "HoldJobRequest":
        check_one_hold(self.hold_s, until_released=self.until_released)
        return self


class HoldResult(MotionResult):
    """Figures of a hold; those of the force are null where the request has none."""

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
    """Mean of the estimate over the hold, its first half second left out."""
    force_error_mN: float | None = None
    """Mean of the estimate less F_r over the same time."""


KIND = JobKind(
    name="hold",
    label="Hold a part",
    summary="Go on holding what is in the gripper, as it is or with a new force.",
    request=HoldJobRequest,
    plan=MotionPlan,
    pair_plan=PairPlan,
    result=HoldResult,
    pair_result=PairResult,
    functions="pincette_supervisor.kinds.hold.functions:FUNCTIONS",
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
            number(
                "force_held_mN",
                "force held",
                uncertainty="force_uncertainty_mN",
                assumed="force_assumed",
                optional=True,
            ),
            number("force_target_mN", "force asked for", optional=True),
            number("force_error_mN", "force error", optional=True),
            number("peak_force_mN", "peak force", optional=True),
        ),
        *fields.for_arms(2, *fields.PAIR_FIGURES),
    ),
    begins_held=True,
    from_present=True,
    arms=(1, 2),
    place=40,
)
