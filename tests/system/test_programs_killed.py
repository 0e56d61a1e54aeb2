"""A program of the loop dies while a job moves, and a grip in which nothing dies; T = 20 ms."""

import signal
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied, GroundTruth
from tests.support.grips import (
    approach,
    hold,
    kill,
    make_ready,
    refused,
    reset,
    restart,
    whole_grip,
)
from tests.support.reactions import REACTION_S, SAFE_S, await_reaction, within
from tests.support.rigs import output_step_V
from tests.support.running import RunningRig
from tests.support.stalls import StallRecorder
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls", "ready")

ANSWERS_S = 5.0


def missed(rig: RunningRig) -> dict[str, int]:
    """Return the ticks that each program has missed since its start."""
    return {program["name"]: program["missed"] for program in rig.view()["programs"]}


def await_answers(rig: RunningRig) -> None:
    """Wait until the supervisor has queried all programs again, which it does twice a second."""
    begun = monotonic()
    while any("no program answers" in reason for reason in rig.view()["reasons"]):
        assert monotonic() - begun < ANSWERS_S
        sleep(0.05)


def test_a_grip_without_a_fault_has_no_trip_and_no_refusal(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, figures: list[str]
) -> None:
    before, refused_before = missed(rig), seen.newest(Applied).refused
    begun = monotonic()
    ended = whole_grip(rig, seen)
    assert ended["result"]["outcome"] == "gripped"
    echoes = seen.since(Applied, begun)
    stood_s = [length_s for at, length_s in stalls.stalls if at >= begun]
    assert echoes[-1][1].refused == refused_before
    ticks = {name: count - before[name] for name, count in missed(rig).items()}
    kept = [at for at, echo in echoes if echo.state == "armed" and echo.seq >= 0]
    unanswered = [
        at for at, echo in echoes if echo.state == "armed" and echo.seq >= 0 and not echo.answered
    ]
    figures.append(
        f"grip without a fault: {len(kept)} ticks, missed {ticks}, without a command "
        f"{len(unanswered)}, stalls {len(stood_s)}"
    )
    for name, count in ticks.items():
        assert count == 0, f"{name} missed {count} ticks"
    assert unanswered == [], "ticks without a command"


@pytest.mark.parametrize(("name", "held"), [("sensor", True), ("estimator", False)])
def test_without_samples_the_actuator_makes_the_rig_safe(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, name: str, held: bool
) -> None:
    job = hold(rig, seen) if held else approach(rig, seen)
    reaction = await_reaction(rig.rig, seen, stalls, kill(rig, name), held=held)
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    assert "command_age" in ended["cause"]
    assert name in ended["cause"]
    assert "command_age" in refused(rig)["cause"]
    restart(rig, name)
    reset(rig)
    make_ready(rig)
    whole_grip(rig, seen)
    safe_s = SAFE_S + (rig.rig.safety.freeze_s if held else 0.0)
    within(REACTION_S, reaction.reaction_s, "the reaction")
    within(safe_s, reaction.safe_s, "the ramp to the safe voltage")


def test_a_restarted_actuator_moves_nothing_until_a_person_resets_it(
    rig: RunningRig, seen: Witness
) -> None:
    job = approach(rig, seen)
    kill(rig, "actuator")
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    assert "actuator" in ended["cause"]
    restart(rig, "actuator")
    started_at = monotonic()
    # None is accepted; until the new program replies, the rig is not ready.
    while (response := rig.post("/jobs", {"kind": "grip", "autostart": True})).status_code == 503:
        assert response.json()["type"].endswith("rig-not-ready"), response.text
        assert monotonic() - started_at < ANSWERS_S, response.text
    problem = refused(rig)
    assert problem["type"].endswith("rig-latched")
    assert problem["cause"] in ("boot", "restart")
    sleep(0.3)
    assert not [echo for _, echo in seen.since(Applied, started_at) if echo.state == "armed"]
    reset(rig)
    make_ready(rig)
    begun = monotonic()
    whole_grip(rig, seen)
    put_V = [truth.arms[0].voltage_V for _, truth in seen.since(GroundTruth, begun)]
    assert abs(put_V[-1] - seen.newest(Applied).arms[0].voltage_V) <= output_step_V(rig.rig)


def test_a_job_whose_actuator_was_restarted_at_once_fails(rig: RunningRig, seen: Witness) -> None:
    job = hold(rig, seen)
    rig.fleet.signal("actuator", signal.SIGKILL)
    restart(rig, "actuator")
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    assert "actuator" in ended["cause"]
    await_answers(rig)
    assert refused(rig)["type"].endswith("rig-latched")
    reset(rig)
    make_ready(rig)
    whole_grip(rig, seen)
