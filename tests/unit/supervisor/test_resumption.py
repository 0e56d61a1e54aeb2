"""A calibration that tripped during a stall restarts automatically, or continues where it was."""

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from pincette.control.record import replace
from pincette.core.faults import Outcome
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.kinds.calibrate.functions import BY_HAND, NO_MORE
from tests.support.arms import with_arm

from . import samples
from .canned import IN_APPROACH
from .harness import Harness

STALLED = "command_age: no command for 51 ms, limit 50 ms"
TICKS = 50
"""Ticks of a noise calibration before its trip."""
WEIGHTS_MN = [0.0, 5.0, 10.0]
STEPS = (0.0, 5.0, 10.0, 5.0, 0.0)
STEP_TICKS = samples.HANG_TICKS + 60
TRUE_UM_PER_MN = 0.46


def begun(harness: Harness, calibration: str, **wishes: Any) -> str:
    """Return a calibration that plays up to a tick."""
    body = {"calibration": calibration, "autostart": True, **wishes}
    response = harness.post("/calibrations", body)
    assert response.status_code == 201, response.text
    job = str(response.json()["id"])
    reached(harness, job)
    return job


def reached(harness: Harness, job: str) -> None:
    """Wait until a job has played as far as its rig lets it."""

    def there() -> bool:
        live = harness.manager.active
        if live is None or live.id != job or live.status.progress is None:
            return False
        return live.status.progress.seq >= harness.bus.place - 1 > 0

    harness.until(there)


def following(harness: Harness, job: str) -> str:
    """Return the name of the job that follows, by the cause of the previous one's end."""
    harness.until(lambda: "as job " in harness.get(f"/jobs/{job}")["cause"])
    return str(harness.get(f"/jobs/{job}")["cause"].rpartition("as job ")[2])


def noisy(ticks: list[samples.Tick]) -> list[samples.Tick]:
    return samples.rest(ticks[0].position.epoch)


def test_a_noise_calibration_restarts_automatically_and_succeeds(real: Harness) -> None:
    real.bus.edit, real.bus.pause_at = noisy, TICKS
    first = begun(real, "noise", duration_s=4.0)
    real.bus.pause_at = None
    real.bus.trip(STALLED)
    ended = real.ended(first)
    assert ended["state"] == "failed"
    assert "begins again from its start" in ended["cause"]
    second = following(real, first)
    done = real.ended(second)
    assert done["state"] == "succeeded"
    assert (done["request"]["tries"], done["request"]["duration_s"]) == (2, 4.0)
    assert real.get("/rigs/demo")["queue"]["halted"] == ""


def test_a_calibration_restarts_no_more_often_than_requested(real: Harness) -> None:
    real.bus.edit, real.bus.pause_at = noisy, TICKS
    job = begun(real, "noise", tries=2)
    real.bus.trip(STALLED)
    again = following(real, job)
    reached(real, again)
    real.bus.trip(STALLED)
    ended = real.ended(again)
    assert ended["state"] == "failed"
    assert NO_MORE in ended["cause"]
    real.freed(again)
    rig = real.get("/rigs/demo")
    assert rig["latch"]["state"] == "latched"
    assert rig["active_job"] is None


@pytest.mark.parametrize("why", ["device: no answer", "estop"])
def test_after_any_other_trip_a_calibration_waits_for_a_person(real: Harness, why: str) -> None:
    real.bus.edit, real.bus.pause_at = noisy, TICKS
    job = begun(real, "noise")
    real.bus.trip(why)
    assert "begins again" not in real.ended(job)["cause"]
    real.freed(job)
    assert real.get("/rigs/demo")["latch"]["state"] == "latched"
    assert len(real.get("/jobs")["jobs"]) == 1


def test_a_calibration_that_presses_a_part_is_restarted_by_a_person(real: Harness) -> None:
    real.bus.pause_at = IN_APPROACH
    job = begun(real, "contact_stiffness")
    real.bus.trip(STALLED)
    assert BY_HAND in real.ended(job)["cause"]
    real.freed(job)
    assert real.get("/rigs/demo")["latch"]["state"] == "latched"
    assert len(real.get("/jobs")["jobs"]) == 1


def weighing(taken: int) -> Callable[[list[samples.Tick]], list[samples.Tick]]:
    """Return an edit that plays a weighing from weight number ``taken`` on, with the true
    compliance."""

    skip = 3 * taken

    def edit(ticks: list[samples.Tick]) -> list[samples.Tick]:
        whole = samples.weighing(ticks[0].position.epoch, STEPS, TRUE_UM_PER_MN)
        left = [samples.numbered(tick, seq) for seq, tick in enumerate(whole[taken * STEP_TICKS :])]
        return [
            replace(tick, telemetry=replace(tick.telemetry, segment=tick.telemetry.segment - skip))
            for tick in left
        ]

    return edit


def waiting(harness: Harness, live: LiveJob) -> None:
    harness.until(lambda: live.status.waiting is not None)


def hang(harness: Harness, job: str, weights_mN: Sequence[float]) -> None:
    """Hang weights as the job requests them."""
    for weight_mN in weights_mN:
        live = harness.live
        assert live.id == job
        waiting(harness, live)
        assert harness.get(f"/jobs/{job}")["progress"]["weight_mN"] == weight_mN
        assert harness.act(job, "continue").status_code == 202


@pytest.mark.parametrize("read", [0, 1, 3])
def test_a_resumed_weighing_continues_with_the_first_unread_weight(
    real: Harness, read: int
) -> None:
    pauses = [step * STEP_TICKS + samples.HANG_TICKS - 1 for step in range(len(STEPS))]
    real.bus.edit, real.bus.pauses = weighing(0), pauses
    first = begun(real, "compliance", weights_mN=WEIGHTS_MN)
    hang(real, first, STEPS[:read])
    live = real.live
    waiting(real, live)
    real.bus.edit, real.bus.pauses = weighing(read), pauses[: len(STEPS) - read]
    real.bus.trip(STALLED)
    ended = real.ended(first)
    assert f"goes on with weight {read + 1} of {len(STEPS)}" in ended["cause"]
    second = following(real, first)
    hang(real, second, STEPS[read:])
    done = real.ended(second)
    assert done["state"] == "succeeded", done["cause"]
    assert len(done["request"]["taken"]) == read
    (value,) = real.get(f"/calibrations/{second}")["values"]
    assert value["value"] == pytest.approx(TRUE_UM_PER_MN, rel=0.01)


FAR_V, FAR_UM = -0.9, -31.0
"""Position of an arm that moves further than its gain predicts; the limit is -30 µm."""


def too_far(ticks: list[samples.Tick]) -> list[samples.Tick]:
    """Return a free motion that ends at a position limit without a trip."""
    made = samples.rest(ticks[0].position.epoch)
    for seq in range(100, 120):
        tick = made[seq]
        made[seq] = replace(
            tick,
            position=with_arm(tick.position, x_um=FAR_UM if seq > 100 else 0.0),
            applied=with_arm(tick.applied, voltage_V=FAR_V),
        )
    last = made[-1]
    made[-1] = replace(last, telemetry=replace(last.telemetry, outcome=Outcome.OVERTRAVEL))
    return made


def test_after_overtravel_the_next_attempt_moves_less(real: Harness) -> None:
    real.bus.edit = too_far
    first = begun(real, "free_response", tries=2)
    ended = real.ended(first)
    assert ended["state"] == "failed"
    second = following(real, first)
    again = real.ended(second)
    assert again["request"]["least_V"] == pytest.approx(0.8 * FAR_V)
    assert again["request"]["tries"] == 1
    assert again["state"] == "failed"
    real.freed(second)
    assert len(real.get("/jobs")["jobs"]) == 2
    assert real.get("/rigs/demo")["latch"]["state"] == "idle"
