"""Actions of a person on a moving job: stop it, abort it, stop everything; T = 20 ms."""

import re
import signal
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied, GroundTruth, Position
from tests.support.grips import (
    FAR_V,
    approach,
    command,
    hold,
    make_ready,
    move_away,
    refused,
    reset,
    restart,
)
from tests.support.reactions import Reaction, await_reaction, distribution, within
from tests.support.running import RunningRig
from tests.support.stalls import StallRecorder
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls", "ready")

ROUNDS = 3
REST_UM = 0.3
"""Largest peak-to-peak motion of an arm at rest, in µm: the sensor's noise, and creep during a
few samples."""

SETTLED_S = 0.6
KEPT_MN = 1.0
"""Largest drift of the true force while a stop takes effect and the part is kept, in mN."""


def act(rig: RunningRig, job: str, action: str) -> None:
    rig.post(f"/jobs/{job}/actions", {"type": action}).raise_for_status()


def check_estop_is_latched(rig: RunningRig) -> None:
    assert refused(rig)["type"].endswith("estop-engaged")
    assert refused(rig)["cause"] == "estop"
    reset(rig)
    assert rig.view()["can_start"]


@pytest.mark.parametrize("held", [True, False], ids=["held", "free"])
def test_an_emergency_stop_over_rest_acts_within_one_period(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, figures: list[str], held: bool
) -> None:
    period_s = rig.rig.rig.period_s
    reactions: list[Reaction] = []
    for _ in range(ROUNDS):
        job = hold(rig, seen) if held else approach(rig, seen)
        asked_at = monotonic()
        response = rig.post("/rigs/demo/estop")
        assert response.status_code == 200, response.text
        reactions.append(await_reaction(rig.rig, seen, stalls, asked_at, held=held))
        ended = rig.ended(job)
        assert ended["state"] == "failed"
        assert "estop" in ended["cause"]
        check_estop_is_latched(rig)
    figures.append(
        distribution(
            f"e-stop over REST, {'part held' if held else 'arm free'}",
            [reaction.reaction_s for reaction in reactions],
            period_s,
            max(reaction.reaction_stalls_s for reaction in reactions),
        )
    )
    for reaction in reactions:
        within(period_s, reaction.reaction_s, "the emergency stop")


@pytest.mark.parametrize("held", [True, False], ids=["held", "free"])
def test_an_emergency_stop_works_without_the_supervisor(
    rig: RunningRig, seen: Witness, stalls: StallRecorder, held: bool
) -> None:
    job = hold(rig, seen) if held else approach(rig, seen)
    killed_at = monotonic()
    rig.fleet.signal("supervisor", signal.SIGKILL)
    stopped = command("estop", "--rig", str(rig.path))
    assert stopped.returncode == 0, stopped.stderr
    # Neither way needs the supervisor; on a busy machine the second confirms first.
    assert re.search("stopped (at the actuator|through the router)", stopped.stdout)
    # The actuator reports the request in the same step, and moves in the next one.
    asked_at, echo = seen.until_state(("frozen", "ramping"), killed_at)
    assert echo.cause == "estop"
    assert asked_at <= monotonic()
    reaction = await_reaction(rig.rig, seen, stalls, asked_at, held=held)
    period_s = rig.rig.rig.period_s
    within(period_s, reaction.reaction_s, "the emergency stop")
    restart(rig, "supervisor")
    assert rig.job(job)["state"] == "interrupted"
    check_estop_is_latched(rig)


def test_a_stop_of_the_free_arm_leaves_it_at_rest(rig: RunningRig, seen: Witness) -> None:
    job = move_away(rig, seen)
    asked_at = monotonic()
    act(rig, job, "stop")
    assert rig.ended(job)["state"] == "stopped"
    sleep(0.3)
    echoes = [echo for _, echo in seen.since(Applied, asked_at)]
    assert all(echo.state in ("armed", "idle") for echo in echoes)
    assert echoes[-1].state == "idle"
    # It may come to rest a little short of its position at the request.
    assert echoes[-1].arms[0].voltage_V < 0.8 * FAR_V, "it went back"
    assert len({echo.arms[0].voltage_V for echo in echoes[-5:]}) == 1
    xs_um = [position.arms[0].x_um for _, position in seen.since(Position, asked_at)][-10:]
    assert max(xs_um) - min(xs_um) < REST_UM
    assert rig.view()["part"] == "none"
    assert rig.view()["can_start"]


def test_a_stop_keeps_a_held_part_until_it_is_released(rig: RunningRig, seen: Witness) -> None:
    job = hold(rig, seen)
    sleep(SETTLED_S)
    before_mN = seen.newest(GroundTruth).arms[0].force_mN
    act(rig, job, "stop")
    assert rig.ended(job)["state"] == "stopped"
    stopped_at = monotonic()
    sleep(SETTLED_S)
    kept_mN = [truth.arms[0].force_mN for _, truth in seen.since(GroundTruth, stopped_at)]
    assert min(kept_mN) > before_mN - KEPT_MN
    assert max(kept_mN) < before_mN + KEPT_MN
    assert rig.view()["part"] == "held"
    assert not rig.view()["can_start"]
    act(rig, job, "release")
    seen.until(Applied, lambda echo: echo.state == "idle", stopped_at)
    make_ready(rig)
    assert rig.view()["part"] == "none"
    assert rig.job(job)["state"] == "stopped"
    assert seen.newest(GroundTruth).arms[0].force_mN == 0.0


def test_an_abort_freezes_a_held_part_and_then_releases_it(
    rig: RunningRig, seen: Witness, stalls: StallRecorder
) -> None:
    job = hold(rig, seen)
    asked_at = monotonic()
    act(rig, job, "abort")
    reaction = await_reaction(rig.rig, seen, stalls, asked_at, held=True)
    assert reaction.cause.startswith("abort: ")
    period_s = rig.rig.rig.period_s
    within(period_s, reaction.reaction_s, "the abort")
    ended = rig.ended(job)
    assert ended["state"] == "aborted"
    assert refused(rig)["cause"] == "abort"
    reset(rig)
    assert rig.view()["can_start"]
