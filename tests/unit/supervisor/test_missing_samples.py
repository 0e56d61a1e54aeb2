"""A calibration with too many missing samples is stopped at once, and not played to its end."""

from collections.abc import Callable

from pincette.control.record import replace
from pincette_supervisor.plugin.figures import MOST_MISSING
from tests.support.arms import with_arm

from . import samples
from .harness import Harness
from .samples import Tick

PLANNED = 400
"""Samples of a noise of 8 s."""
FEW = int(MOST_MISSING * PLANNED)
LOST_FROM, PLAYED = 60, 300
"""Ticks: the first that is lost, and up to where the rig plays at most."""


def lacking(count: int) -> Callable[[list[Tick]], list[Tick]]:
    """Return an arm at rest, with a number of consecutive readings missing."""
    gone = range(LOST_FROM, LOST_FROM + count)

    def edit(ticks: list[Tick]) -> list[Tick]:
        return [
            replace(tick, position=with_arm(tick.position, valid=tick.position.seq not in gone))
            for tick in samples.rest(ticks[0].position.epoch, ticks=PLANNED)
        ]

    return edit


def test_a_phase_that_lacks_too_many_samples_ends_the_calibration(harness: Harness) -> None:
    harness.bus.edit, harness.bus.pause_at = lacking(4 * FEW), PLAYED
    job = harness.calibrated("noise", duration_s=8.0)
    assert job["state"] == "failed"
    assert f" of the {PLANNED} samples of noise are missing already, limit 2 %" in job["cause"]
    assert int(job["cause"].split()[0]) > FEW
    assert job["ending"]["code"] == "samples_missing"
    assert job["ending"]["values"]["planned"] == PLANNED
    assert harness.bus.acts == ["retract"]
