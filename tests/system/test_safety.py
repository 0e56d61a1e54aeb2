"""The controller dies or hangs, with the arm free and with a part held; T = 20 ms.

Its end is not announced: the actuator notices only that no command arrives. After a hang the queued
commands arrive in a burst, either while the voltage is still frozen, or after the ramp.
"""

import random
import re
import signal
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied, Command
from tests.support.grips import (
    approach,
    hold,
    kill,
    make_ready,
    refused,
    reset,
    restart,
    wait_for_any_phase,
    whole_grip,
)
from tests.support.reactions import (
    REACTION_S,
    SAFE_S,
    Reaction,
    await_reaction,
    distribution,
    within,
)
from tests.support.running import RunningRig
from tests.support.stalls import StallRecorder
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls")

ROUNDS = (2, pytest.param(20, marks=pytest.mark.slow))
"""Number of rounds of each kind, at random phases of a period; for every commit and for the
soak, whose larger part is `test_soak_faults`."""
WAKE_EARLY_S = 0.15
"""Time after which a hung controller continues while the voltage of a held part is still frozen,
in s."""
WAKE_LATE_S = 0.8
"""Time after which it continues when the actuator is latched and Zenoh has closed its links, in
s."""
SILENCE = re.compile(r"command_age: controller silent for (\d+) ms, limit 50 ms")
"""Cause of the trip as the actuator states it; it knows only that no command arrived."""


def suffer(rig: RunningRig, seen: Witness, stalls: StallRecorder, *, held: bool) -> Reaction:
    """Kill the controller and check the reaction."""
    return await_reaction(rig.rig, seen, stalls, kill(rig, "controller"), held=held)


def hang(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, *, held: bool, wake_s: float
) -> Reaction:
    """Stop the controller without notice, and let it continue."""
    hung_at = monotonic()
    rig.fleet.signal("controller", signal.SIGSTOP)
    sleep(wake_s)
    rig.fleet.signal("controller", signal.SIGCONT)
    return await_reaction(rig.rig, seen, stalls, hung_at, held=held)


def check_no_command_was_taken(seen: Witness, since_s: float) -> tuple[int, int]:
    """Check commands that arrived after the trip; returns how many of them were refused."""
    tripped_at, trip = seen.until_state(("frozen", "ramping"), since_s)
    echoes = [echo for _, echo in seen.since(Applied, tripped_at)]
    assert not [echo for echo in echoes if echo.answered]
    came = [command for _, command in seen.since(Command, tripped_at) if command.valid]
    return len(came), echoes[-1].refused - trip.refused


def check_words(rig: RunningRig, job: str) -> None:
    """Check that the job has failed with a reason, and that the next one is refused until a
    reset."""
    ended = rig.ended(job)
    assert ended["state"] == "failed"
    silence = SILENCE.search(ended["cause"])
    assert silence is not None, ended["cause"]
    assert int(silence[1]) >= 50
    problem = refused(rig)
    assert problem["type"].endswith("rig-latched")
    assert problem["cause"] == "command_age"
    assert silence[0] in problem["detail"]


@pytest.mark.parametrize("rounds", ROUNDS)
@pytest.mark.parametrize(("fault", "held"), [("killed", True), ("hung", False)])
def test_without_the_controller_the_actuator_makes_the_rig_safe(
    rig: RunningRig,
    seen: Witness,
    stalls: StallRecorder,
    figures: list[str],
    fault: str,
    held: bool,
    rounds: int,
) -> None:
    make_ready(rig)
    chance = random.Random(f"{fault} {held}")
    reactions: list[Reaction] = []
    late = refusals = 0
    safe_s = SAFE_S + (rig.rig.safety.freeze_s if held else 0.0)
    try:
        for count in range(rounds):
            job = hold(rig, seen) if held else approach(rig, seen)
            wait_for_any_phase(chance, rig.rig.rig.period_s)
            begun = monotonic()
            if fault == "killed":
                reactions.append(suffer(rig, seen, stalls, held=held))
            else:
                wake_s = WAKE_EARLY_S if count % 2 else WAKE_LATE_S
                reactions.append(hang(rig, seen, stalls, held=held, wake_s=wake_s))
            check_words(rig, job)
            came, refusal_count = check_no_command_was_taken(seen, begun)
            late, refusals = late + came, refusals + refusal_count
            if fault == "killed":
                assert "controller" in rig.job(job)["cause"]
                restart(rig, "controller")
            reset(rig)
        whole_grip(rig, seen)
    finally:
        arm = "part held" if held else "arm free"
        figures += describe(f"controller {fault}, {arm}", reactions, safe_s)
        if fault == "hung":
            figures.append(f"  of {late} commands that came late, {refusals} were refused")
    for reaction in reactions:
        within(REACTION_S, reaction.reaction_s, "the reaction")
        within(safe_s, reaction.safe_s, "the ramp to the safe voltage")


def describe(name: str, reactions: list[Reaction], safe_s: float) -> list[str]:
    if not reactions:
        return [f"{name}: no round came to its end"]
    return [
        distribution(
            f"{name}: reaction",
            [reaction.reaction_s for reaction in reactions],
            REACTION_S,
            max(reaction.reaction_stalls_s for reaction in reactions),
        ),
        distribution(
            f"{name}: safe",
            [reaction.safe_s for reaction in reactions],
            safe_s,
            max(reaction.safe_stalls_s for reaction in reactions),
        ),
    ]
