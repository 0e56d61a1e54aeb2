"""``grip``: grip a part, hold it and release it."""

from typing import Literal

from pydantic import model_validator

from pincette.api import example
from pincette.api.job_kinds import FieldSpec, JobKind, RecipeRules, ResultField, choices, number
from pincette.api.pairs import PairPlan, PairResult
from pincette.api.plans import Plan
from pincette.api.requests import (
    ContactJobRequest,
    Duration,
    PlacedRequest,
    Positive,
    Speed,
    check_one_hold,
)
from pincette.api.results import COMMON, ClosedLoopResult, ErrorSources
from pincette_supervisor.kinds import fields


class GripJobRequest(ContactJobRequest, PlacedRequest, frozen=True):
    """Grip a part with the arm or both arms of a rig. Defaults come from the rig file."""

    model_config = example(kind="grip", autostart=True, force_mN=20.0, labels={"part": "bead 12"})

    kind: Literal["grip"]
    force_mN: Positive | None = None
    """Force to hold."""
    hold_s: Duration | None = None
    """Duration of the hold."""
    until_released: bool = False
    """Hold until the action ``release``; excludes ``hold_s``."""
    profile: Literal["quick", "gentle"] | None = None
    """``quick``: the load begins at the touch without a stop; ``gentle``: the arm stops at the
    touch."""
    load_um_per_s: Speed | None = None
    """Peak speed of a quick load and unload; excludes ``load_s``."""
    place_um: float | None = None
    """Two arms only: place q = (x_1 - x_2)/2 to which the held part is carried. None: the place
    where it was found.
    """
    centre: bool = False
    """Two arms only: find the part with one arm after the other, then grip it where it is. The
    support must hold the part by more than the contact force. The part may be off by the rig file's
    ``part.contact_tolerance_um``."""

    @model_validator(mode="after")
    def _one_load(self) -> "GripJobRequest":
        if self.load_um_per_s is not None and self.load_s is not None:
            raise ValueError(
                f"load_s = {self.load_s} s and load_um_per_s = {self.load_um_per_s} µm/s "
                "exclude each other: give one of them, the other follows"
            )
        return self

    @model_validator(mode="after")
    def _one_hold(self) -> "GripJobRequest":
        check_one_hold(self.hold_s, until_released=self.until_released)
        return self


class GripResult(ClosedLoopResult):
    """Results of a grip; a value is null if the grip did not reach its phase."""

    model_config = example(
        outcome="gripped",
        phases=[{"phase": "hold", "start_s": 8.9, "duration_s": 4.0}],
        **COMMON,
        force_target_mN=20.0,
        force_held_mN=19.99,
        force_error_mN=-0.01,
        rmse_position_um=0.031,
        rmse_force_mN=0.11,
        true_force_held_mN=19.8,
    )

    force_target_mN: float
    force_held_mN: float | None
    """Mean of the estimated force over the hold without its first half second."""
    force_error_mN: float | None
    """Mean of the estimate minus F_r over the hold without its first half second."""
    rmse_position_um: float | None
    """R.m.s. of x minus x_r over the hold."""
    rmse_force_mN: float | None
    """R.m.s. of the estimate minus F_r over the hold."""
    true_force_held_mN: float | None
    """Mean of the true force, which only a simulated rig knows; null on a real one."""
    error_sources: ErrorSources | None = None
    """Causes of the errors over the hold without its first half second; null if nothing was
    held.
    """


FIGURES: tuple[ResultField, ...] = (
    *fields.CONTACT,
    *fields.PLACE_FOUND,
    number(
        "force_held_mN",
        "force held",
        uncertainty="force_uncertainty_mN",
        assumed="force_assumed",
        main=True,
    ),
    number("force_target_mN", "requested force"),
    *fields.GOAL,
    *fields.ZERO_RETURN,
    *fields.RELEASE_VERDICT,
    *fields.POSITION_STEP,
    number("force_error_mN", "force error"),
    number("peak_force_mN", "peak force"),
    number("rmse_position_um", "RMSE of the position during the hold", digits=3),
    number("rmse_force_mN", "RMSE of the force during the hold", digits=3),
    number("true_force_held_mN", "true force held, by the simulation", optional=True),
    *fields.ERROR_SOURCES,
)
KIND = JobKind(
    name="grip",
    label="Grip",
    summary="Grip the part of the rig file, hold it and release it.",
    request=GripJobRequest,
    plan=Plan,
    pair_plan=PairPlan,
    result=GripResult,
    pair_result=PairResult,
    figures_in_prediction=True,
    functions="pincette_supervisor.kinds.grip.functions:FUNCTIONS",
    form=(
        fields.ZERO_CONFIRMED,
        fields.RECIPE,
        FieldSpec(name="force_mN", label="Force", limit="force_max", planned="load.force_mN"),
        FieldSpec(name="hold_s", label="Hold", planned="hold.duration_s"),
        FieldSpec(name="until_released", label="Hold until released", excludes="hold_s"),
        *fields.for_arms(
            1,
            FieldSpec(
                name="profile",
                label="Profile",
                choices=choices(
                    ("", "quick if the model allows it, else gentle"),
                    ("quick", "quick: loads at the touch"),
                    ("gentle", "gentle: stops at the touch"),
                ),
                advanced=True,
            ),
            FieldSpec(name="load_um_per_s", label="Load at most at", advanced=True),
            fields.CONDITION,
            *fields.TOLERANCES,
            *fields.LAW,
        ),
        *fields.for_arms(
            2,
            FieldSpec(name="place_um", label="Carry to", placeholder="where it is"),
            FieldSpec(name="centre", label="Find the part from both sides first"),
            *fields.PAIR_LAW,
        ),
        *fields.PLACE,
        *fields.POLICIES,
    ),
    figures=(
        *fields.for_arms(1, *FIGURES),
        *fields.for_arms(2, *fields.PAIR_FIGURES, *fields.PLACE_FOUND, *fields.WIDTH_FOUND),
    ),
    brief={
        "force_held_mN": "force held",
        "force_target_mN": "requested force",
        "peak_force_mN": "peak force",
        "contact_stiffness_mN_per_um": "contact stiffness",
        "held_place_um": "place",
        "difference_mN": "difference of both forces",
        "zero_return.force_mN": "zero return",
    },
    predicted=True,
    relative=("place",),
    goal_phase="hold",
    recipe=RecipeRules(exclusive=(("hold_s", "until_released"), ("load_s", "load_um_per_s"))),
    arms=(1, 2),
    only={
        1: fields.ONE_ARM | {"profile", "load_um_per_s"},
        2: frozenset({"place_um", "centre"}),
    },
    place=10,
)
