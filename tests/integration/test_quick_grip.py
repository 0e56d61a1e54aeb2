"""A quick grip of the demo rig in one process: its time, its force, and other parts."""

from math import fsum
from typing import NamedTuple

import pytest

from pincette.config import RigFile
from pincette.core.messages import Estimate, GroundTruth, Telemetry
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job
from tests.support.rigs import Tree, demo_rig

FORCE_MN = 20.0


class Grip(NamedTuple):
    """Outcome of a grip."""

    outcome: str
    phases: list[str]
    without_hold_s: float
    peak_mN: float
    held_mN: list[float]
    covered: float
    """Share of the hold's samples whose true force is within F ± U."""
    at_touch_mN: float


def gripped(simulation: Tree | None = None, **wishes: object) -> Grip:
    rig: RigFile = demo_rig({"simulation": simulation or {}}, time="lockstep")
    planned = plan_job(GripJobRequest.model_validate({"kind": "grip", **wishes}), rig)
    assert planned.plan.violations == []
    published = ComposedLoop(rig).play(planned.program)
    views = [message for message in published if isinstance(message, Telemetry)]
    true_mN = {m.seq: m.arms[0].force_mN for m in published if isinstance(m, GroundTruth)}
    by_seq = {m.seq: m for m in published if isinstance(m, Estimate)}
    hold = [view.seq for view in views if view.phase == "hold"]
    within = [
        abs(by_seq[seq].arms[0].force_mN - true_mN[seq]) <= by_seq[seq].arms[0].force_uncertainty_mN
        for seq in hold
    ]
    load = [view.seq for view in views if view.phase == "load"]
    return Grip(
        str(views[-1].outcome),
        list(dict.fromkeys(view.phase for view in views)),
        rig.rig.period_s * (len(views) - len(hold)),
        max(true_mN.values()),
        [true_mN[seq] for seq in hold],
        sum(within) / len(within) if within else 0.0,
        true_mN[load[0]] if load else 0.0,
    )


def test_a_grip_is_quick_by_default() -> None:
    grip = gripped()
    assert grip.outcome == "gripped"
    assert grip.without_hold_s <= 3.0
    assert grip.at_touch_mN < 0.5 * FORCE_MN
    assert grip.peak_mN < 1.06 * FORCE_MN
    mean_mN = fsum(grip.held_mN) / len(grip.held_mN)
    print(f"{grip.without_hold_s:.2f} s, peak {grip.peak_mN:.2f} mN, held {mean_mN:.2f} mN")
    assert abs(mean_mN - FORCE_MN) < 0.8
    assert grip.covered >= 0.9


def test_a_gentle_grip_has_a_different_plan() -> None:
    grip = gripped(profile="gentle", hold_s=0.5)
    assert grip.outcome == "gripped"
    assert grip.without_hold_s > 10.0
    assert grip.at_touch_mN < 0.15 * FORCE_MN


@pytest.mark.parametrize("factor", [0.5, 1.25, 2.0])
def test_a_part_of_another_stiffness_than_planned_is_not_pressed_much_harder(factor: float) -> None:
    grip = gripped({"environment_stiffness_mN_per_um": 2.17 * factor}, hold_s=0.5)
    assert grip.outcome == ("gripped" if 0.7 < factor < 1.3 else "wrong_stiffness")
    assert grip.at_touch_mN < 0.5 * FORCE_MN
    print(f"K_e times {factor}: peak {grip.peak_mN:.2f} mN")
    assert grip.peak_mN < 1.15 * FORCE_MN


@pytest.mark.parametrize("contact_um", [9.0, 21.0])
def test_a_part_much_nearer_than_planned_is_detected_on_the_approach(contact_um: float) -> None:
    grip = gripped({"bead_contact_um": contact_um}, hold_s=0.5)
    assert grip.outcome == "contact"
    assert grip.phases == ["zero", "approach", "retreat"]
    print(f"part at {contact_um} µm: peak {grip.peak_mN:.2f} mN")
    assert grip.peak_mN < 0.75 * FORCE_MN


def test_a_light_quick_grip_is_as_slow_as_its_force_requires() -> None:
    grip = gripped(force_mN=6.0, hold_s=0.5)
    assert grip.outcome == "gripped"
    assert grip.at_touch_mN < 3.3
    assert grip.peak_mN < 7.5
