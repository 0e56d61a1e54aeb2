"""Fifty clients read and plan during a grip: the loop is not affected, and an emergency stop
succeeds."""

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
SHORT_S, LONG_S = 3.0, 20.0
"""Durations of the holds of the compared grips."""
AGE_PERIODS = 0.25
ESTOP_S = 0.2
FEW, MANY = 20, 100
"""Number of emergency stops, and the limit of the 99th percentile of their times."""
ASKED_PER_S = 10.0
"""Smallest request rate that counts as a load, in 1/s."""


@dataclass(frozen=True, slots=True)
class Loop:
    """Figures of the loop during a grip."""

    ticks: int
    missed: int
    """Return the number of samples never taken, and of ticks for which the actuator accepted no
    command."""
    age_p99_s: float


def grip(rig: RunningRig, hold_s: float) -> Loop:
    """Grip for a while and evaluate the record."""
    ended = rig.ended(rig.start_grip(hold_s=hold_s), hold_s + 60.0)
    assert ended["state"] == "succeeded", ended["cause"]
    result = cast(Json, ended["result"])
    path = rig.data / "jobs" / ended["id"] / "samples.parquet"
    ages = cast(Any, parquet).read_table(path)["command_age_s"].to_pylist()
    age_p99_s = float(np.percentile([age for age in ages if age is not None], 99.0))
    missed = result["missed_ticks"] + result["unanswered_ticks"]
    return Loop(result["samples"], missed, age_p99_s)


def estop_s(rig: RunningRig) -> float:
    """Return the time until the reply to an emergency stop, in s."""
    asked_s = monotonic()
    rig.post(f"/rigs/{rig.rig.rig.name}/estop").raise_for_status()
    return monotonic() - asked_s


@pytest.mark.parametrize(
    ("hold_s", "old_jobs", "estops"),
    [(SHORT_S, 1, FEW), pytest.param(LONG_S, 5, MANY, marks=pytest.mark.slow)],
)
def test_fifty_clients_do_not_disturb_the_loop(
    rig: RunningRig,
    stalls: StallRecorder,
    figures: list[str],
    hold_s: float,
    old_jobs: int,
    estops: int,
) -> None:
    make_ready(rig)
    begun_s = monotonic()
    for _ in range(old_jobs):
        assert rig.ended(rig.start_grip())["state"] == "succeeded"
    idle = grip(rig, hold_s)
    with hammered(rig, CLIENTS) as requested:
        hammered_s = monotonic()
        busy = grip(rig, hold_s)
        rig.until_phase(rig.start_grip(until_released=True), "hold")
        answers_s = [estop_s(rig)]
        for _ in range(estops - 1):
            sleep(0.1)
            answers_s.append(estop_s(rig))
        hammered_s = monotonic() - hammered_s
    p99_s = float(np.percentile(answers_s, 99.0))
    make_ready(rig)
    period_s = rig.rig.rig.period_s
    for name, loop in (("idle", idle), (f"{CLIENTS} clients", busy)):
        figures.append(
            f"{name}: {loop.ticks} ticks, {loop.missed} missed, age p99 "
            f"{1e3 * loop.age_p99_s:.2f} ms of {1e3 * AGE_PERIODS * period_s:.2f} ms"
        )
    figures.append(
        f"{requested['asked']} questions, p50 {1e3 * requested['p50_s']:.0f} ms, p99 "
        f"{1e3 * requested['p99_s']:.0f} ms, answers {requested['answers']}; {estops} emergency "
        f"stops answered within {1e3 * p99_s:.0f} ms at p99, the first of them, which trips, "
        f"within {1e3 * answers_s[0]:.0f} ms; the machine stood still for "
        f"{1e3 * stalls.between(begun_s, monotonic()):.0f} ms in all"
    )
    assert requested["asked"] >= ASKED_PER_S * hammered_s
    assert requested["answers"].keys() == {"200"}
    assert busy.missed <= idle.missed
    assert busy.age_p99_s <= AGE_PERIODS * period_s
    assert p99_s <= ESTOP_S
