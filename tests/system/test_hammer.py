"""Fifty clients read and plan while a grip runs: the loop does not notice, estop comes through."""

from dataclasses import dataclass
from time import monotonic, sleep
from typing import Any, cast

import numpy as np
import pyarrow.parquet as parquet
import pytest

from tests.support.grips import make_ready
from tests.support.hammer import hammered
from tests.support.running import Json, RunningRig
from tests.support.stalls import StallRecorder

pytestmark = pytest.mark.usefixtures("stalls")

CLIENTS = 50
OLD_JOBS = 5
HOLD_S = 20.0
AGE_PERIODS = 0.25
ESTOP_S = 0.2
ESTOPS = 5
LEAST_ASKED = 500
"""Questions below which nobody would speak of hammering."""


@dataclass(frozen=True, slots=True)
class Loop:
    """How the loop did during a grip."""

    ticks: int
    missed: int
    """Samples that were never taken, and ticks for which the actuator took no command."""
    age_p99_s: float


def grip(rig: RunningRig) -> Loop:
    """Grip for a while and look at the record."""
    ended = rig.ended(rig.start_grip(hold_s=HOLD_S), HOLD_S + 30.0)
    assert ended["state"] == "succeeded", ended["cause"]
    result = cast(Json, ended["result"])
    path = rig.data / "jobs" / ended["id"] / "samples.parquet"
    ages = cast(Any, parquet).read_table(path)["command_age_s"].to_pylist()
    age_p99_s = float(np.percentile([age for age in ages if age is not None], 99.0))
    missed = result["missed_ticks"] + result["unanswered_ticks"]
    return Loop(result["samples"], missed, age_p99_s)


def estop_s(rig: RunningRig) -> float:
    """How long the answer to an emergency stop takes."""
    asked_s = monotonic()
    rig.post(f"/rigs/{rig.rig.rig.name}/estop").raise_for_status()
    return monotonic() - asked_s


@pytest.mark.slow
def test_the_loop_does_not_notice_fifty_clients(
    rig: RunningRig, stalls: StallRecorder, figures: list[str]
) -> None:
    begun_s = monotonic()
    for _ in range(OLD_JOBS):
        assert rig.ended(rig.start_grip())["state"] == "succeeded"
    idle = grip(rig)
    with hammered(rig, CLIENTS) as asked:
        busy = grip(rig)
        rig.until_phase(rig.start_grip(until_released=True), "hold")
        answers_s = [estop_s(rig)]
        for _ in range(ESTOPS - 1):
            sleep(0.5)
            answers_s.append(estop_s(rig))
    make_ready(rig)
    period_s = rig.rig.rig.period_s
    for name, loop in (("idle", idle), (f"{CLIENTS} clients", busy)):
        figures.append(
            f"{name}: {loop.ticks} ticks, {loop.missed} missed, age p99 "
            f"{1e3 * loop.age_p99_s:.2f} ms of {1e3 * AGE_PERIODS * period_s:.2f} ms"
        )
    figures.append(
        f"{asked['asked']} questions, p50 {1e3 * asked['p50_s']:.0f} ms, p99 "
        f"{1e3 * asked['p99_s']:.0f} ms, answers {asked['answers']}; estop answered within "
        f"{1e3 * max(answers_s):.0f} ms; the machine stood still for "
        f"{1e3 * stalls.between(begun_s, monotonic()):.0f} ms in all"
    )
    assert asked["asked"] >= LEAST_ASKED
    assert asked["answers"].keys() == {"200"}
    assert busy.missed <= idle.missed
    assert busy.age_p99_s <= AGE_PERIODS * period_s
    assert max(answers_s) <= ESTOP_S
