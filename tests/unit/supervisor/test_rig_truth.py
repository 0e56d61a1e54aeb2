"""The reported state of a rig is consistent: state, start and stage follow from one table."""

from typing import Any, get_args

import pytest

from pincette.api.rig_states import RIG_STATES, RigState

from .canned import IN_APPROACH
from .harness import Harness


def told(harness: Harness) -> dict[str, Any]:
    """Return the state of the rig, after comparing it with the table."""
    rig = harness.get("/rigs/demo")
    state = rig["latch"]["state"]
    assert state == rig["standing"]["state"]
    entry = RIG_STATES[state]
    if not entry.may_start:
        assert not rig["can_start"]
        assert rig["reasons"]
        assert "start_job" not in rig["allowed_actions"]
    if not entry.may_move:
        assert not rig["safe_to_move"]["value"]
    if rig["can_start"]:
        assert entry.may_start
        assert "start_job" in rig["allowed_actions"]
    if "reset" in rig["allowed_actions"]:
        assert state in ("latched", "frozen")
    return rig


def test_every_rig_state_is_in_the_state_table() -> None:
    assert set(get_args(RigState)) == set(RIG_STATES)


def test_a_fresh_rig_is_switched_on_and_not_latched(harness: Harness) -> None:
    rig = told(harness)
    assert rig["latch"]["state"] == "switched_on"
    assert (rig["can_start"], rig["safe_to_move"]["value"]) == (True, False)
    harness.bus.idle()  # its state is known, and the stage may move
    rig = told(harness)
    assert rig["latch"]["state"] == "switched_on"
    assert (rig["can_start"], rig["safe_to_move"]["value"]) == (True, True)


def test_reported_states_agree_through_a_job_a_stop_and_a_reset(harness: Harness) -> None:
    told(harness)
    job = harness.playing_to(IN_APPROACH)
    assert told(harness)["latch"]["state"] == "armed"
    harness.post("/rigs/demo/estop")
    harness.ended(job)
    harness.freed(job)
    rig = told(harness)
    assert (rig["latch"]["state"], rig["latch"]["cause"]) == ("latched", "estop")
    harness.post("/rigs/demo/reset", {"acknowledge": True})
    assert told(harness)["latch"]["state"] == "idle"


@pytest.mark.parametrize("program", ["actuator", "sensor"])
def test_a_silent_rig_cannot_start(harness: Harness, program: str) -> None:
    harness.bus.kill(program)
    assert not told(harness)["can_start"]
