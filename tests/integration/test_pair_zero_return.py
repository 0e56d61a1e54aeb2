"""Zero return of both arms of a rig, and a sensor that drifts while it holds."""

from typing import Any

import pytest

from pincette.api.pairs import PairResult
from pincette.api.results import ZeroReturn
from pincette.config.script import ScriptedOrder
from pincette_supervisor.kinds.grip import KIND
from pincette_supervisor.results.archive import zero_returns
from pincette_supervisor.results.documents import verdict
from tests.integration.test_two_arm_jobs import lockstep, play

GRIP = {"kind": "grip", "force_mN": 12.0, "hold_s": 2.0}
HELD_S = 9.0
"""Time within the hold, in s."""


def returned(**simulation: Any) -> tuple[PairResult, dict[str, ZeroReturn | None]]:
    """Play a grip of both arms; returns their zero returns."""
    rig = lockstep(**simulation)
    result, table, _ = play(GRIP, rig)
    assert isinstance(result, PairResult)
    return result, zero_returns(result, table, rig)


def test_both_arms_of_an_undisturbed_grip_are_verified() -> None:
    result, found = returned()
    assert result.outcome == "gripped"
    for name in ("zero_return", "second_zero_return"):
        each = found[name]
        assert each is not None, name
        assert each.verified
        assert 0.1 < each.uncertainty_mN < 1.5


def test_the_arm_whose_sensor_jumps_is_named() -> None:
    order = ScriptedOrder(at_s=HELD_S, target="second_sensor", what="wrong", value=0.8)
    result, found = returned(script=(order,), scripts=True)
    assert result.outcome == "gripped"
    first, second = found["zero_return"], found["second_zero_return"]
    assert first is not None
    assert second is not None
    assert first.verified
    assert not second.verified
    assert second.force_mN == pytest.approx(-0.8 / 0.46, rel=0.25)
    words = verdict(KIND, result.model_copy(update=found).model_dump())
    assert "the second arm" in words
