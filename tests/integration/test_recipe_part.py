"""A part that is not the rig file's: gripped by a recipe that says where it is, and how stiff."""

from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.core.messages import Estimate, GroundTruth, Message, Reset, Telemetry
from pincette.core.topics import ESTIMATE, GROUND_TRUTH, RESET, TELEMETRY
from pincette.engine.arming import arm
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.journal.library import RecipeRow
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan, resolve
from pincette_supervisor.plugin import Planned
from pincette_supervisor.plugin.model_in_use import rig_file_alone
from tests.support.rigs import demo_rig

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
FORCE_MN = 10.0
FARTHER_UM = 40.0
"""Where a small object is met: 10 µm beyond the rig file's 30 µm, whose tolerance is 3 µm."""
SOFTER = 0.9
"""Stiffness of a soft object in mN/µm, below the 1.52 that the rig file's tolerance admits."""


def rig(contact_um: float, stiffness_mN_per_um: float) -> RigFile:
    """The demo rig with another object in its gripper than its file says."""
    thing = {
        "bead_contact_um": contact_um + 0.5,
        "environment_stiffness_mN_per_um": stiffness_mN_per_um,
    }
    return demo_rig({"simulation": thing}, time="lockstep")


def planned(file: RigFile, part: dict[str, float]) -> Planned:
    values: dict[str, Any] = {
        "force_mN": FORCE_MN,
        "hold_s": 1.0,
        **({"part": part} if part else {}),
    }
    row = RecipeRow("object", 1, values, "", "2026-03-01T12:00:00.000Z")
    request = REQUEST.validate_python({"kind": "grip", "recipe": "object"})
    return plan(resolve(request, rig_file_alone(file), None, lambda _reference: row))


def played(file: RigFile, planned: Planned, calibration: str) -> list[Message]:
    loop = ComposedLoop(file)
    published: list[Message] = []
    for topic in (ESTIMATE, TELEMETRY, GROUND_TRUTH):
        loop.bus.subscribe(topic, lambda _topic, message: published.append(message))
    loop.bus.call(RESET, Reset(acknowledge=True))
    arm(loop.bus, planned.program, epoch=1, digest=file.digest(), calibration=calibration)
    while loop.bus.pump():
        pass
    return published


def outcome(messages: list[Message]) -> str:
    return [item for item in messages if isinstance(item, Telemetry)][-1].outcome


@pytest.mark.parametrize(
    ("contact_um", "stiffness_mN_per_um", "part", "otherwise"),
    [
        (FARTHER_UM, 2.17, {"contact_um": FARTHER_UM}, "no_contact"),
        (30.0, SOFTER, {"stiffness_mN_per_um": SOFTER}, "wrong_stiffness"),
    ],
    ids=["farther", "softer"],
)
def test_the_recipes_numbers_grip_what_the_rig_files_do_not(
    contact_um: float, stiffness_mN_per_um: float, part: dict[str, float], otherwise: str
) -> None:
    file = rig(contact_um, stiffness_mN_per_um)
    by_rig_file = planned(file, {})
    assert outcome(played(file, by_rig_file, by_rig_file.armed.calibration.text())) == otherwise
    by_recipe = planned(file, part)
    messages = played(file, by_recipe, by_recipe.armed.calibration.text())
    assert outcome(messages) == "gripped"
    held = {item.seq for item in messages if isinstance(item, Telemetry) and item.phase == "hold"}
    settled = sorted(held)[len(held) // 2 :]
    true = {item.seq: item.arms[0].force_mN for item in messages if isinstance(item, GroundTruth)}
    said = {item.seq: item for item in messages if isinstance(item, Estimate)}
    for seq in settled:
        assert true[seq] == pytest.approx(FORCE_MN, abs=1.0)
        uncertainty_mN = said[seq].arms[0].force_uncertainty_mN
        assert said[seq].arms[0].force_mN == pytest.approx(true[seq], abs=2.0 * uncertainty_mN)


def test_the_plan_alone_would_not_do() -> None:
    """An estimator that keeps to the rig file zeroes no force where its part could be touched."""
    file = rig(FARTHER_UM, 2.17)
    by_recipe = planned(file, {"contact_um": FARTHER_UM})
    assert outcome(played(file, by_recipe, "")) == "zero_refused"
