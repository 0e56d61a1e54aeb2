"""A part that presses the arm between two jobs is never included in the zero, however often a
job starts."""

from pathlib import Path

import pytest

from pincette.config.reading import laid_over
from pincette.core.messages import Estimate, Message
from pincette.core.topics import ESTIMATE, Topic
from tests.integration.test_grip_after_a_stop import SHORT, Bench
from tests.support.rigs import demo_rig

GRIP = {"kind": "grip", "force_mN": 15.0, "hold_s": 1.0}
REFUSED = ("contact", "zero_refused")
LARGEST_MN = 1.1 * 15.0


class Rig(Bench):
    """A virtual rig that has gripped once, so its force has a good zero."""

    def __init__(self, data: Path, drift_um_per_min: float = 0.0) -> None:
        scripted = laid_over(SHORT, {"simulation": {"scripts": True}})
        scripted = laid_over(scripted, {"sensor": {"drift_um_per_min": drift_um_per_min}})
        super().__init__(demo_rig(scripted, time="lockstep"), data)
        self.estimates: list[Estimate] = []
        self.virtual.bus.subscribe(ESTIMATE, self._note)
        assert self.grip() == "gripped"

    def _note(self, _topic: Topic, estimate: Message) -> None:
        assert isinstance(estimate, Estimate)
        self.estimates.append(estimate)

    def grip(self) -> str:
        self.estimates.clear()
        self.truth.clear()
        outcome, _ = self.play(GRIP)
        return outcome

    def largest_mN(self) -> float:
        return max(truth.arms[0].force_mN for truth in self.truth)


@pytest.mark.parametrize(
    ("contact_um", "drift_um_per_min"),
    [(-2.5, 0.0), (-9.8, 1.0)],
)
def test_a_part_that_presses_at_rest_stops_every_grip(
    tmp_path: Path, contact_um: float, drift_um_per_min: float
) -> None:
    rig = Rig(tmp_path, drift_um_per_min)
    rig.virtual.order("part", "place", contact_um, None)
    pressed_mN: list[float] = []
    for _ in range(4):
        assert rig.grip() in REFUSED
        pressed_mN.append(rig.truth[-1].arms[0].force_mN)
        assert rig.estimates[-1].arms[0].force_mN == pytest.approx(pressed_mN[-1], abs=1.5)
        assert rig.estimates[-1].arms[0].zero_age_s is None
    # The law keeps the arm in place, so that it presses no harder with each attempt.
    assert max(pressed_mN) < pressed_mN[0] + 1.0


@pytest.mark.parametrize("contact_um", [-0.3, -1.5])
def test_a_part_that_presses_less_than_a_touch_is_found_during_the_motion(
    tmp_path: Path, contact_um: float
) -> None:
    rig = Rig(tmp_path)
    rig.virtual.order("part", "place", contact_um, None)
    for _ in range(3):
        assert rig.grip() in REFUSED
        assert rig.largest_mN() < 0.6 * 15.0
    rig.virtual.order("part", "remove", None, None)
    assert rig.grip() == "no_contact"
    stated = [estimate for estimate in rig.estimates if estimate.arms[0].zero_age_s is not None]
    assert stated
    assert all(estimate.arms[0].force_mN > -2.0 for estimate in stated)


def test_once_the_part_is_removed_the_next_grip_succeeds(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.virtual.order("part", "place", -9.8, None)
    assert rig.grip() in REFUSED
    rig.virtual.order("part", "remove", None, None)
    assert rig.grip() == "no_contact"
    stated = [estimate for estimate in rig.estimates if estimate.arms[0].zero_age_s is not None]
    assert stated
    assert all(estimate.arms[0].force_mN > -2.0 for estimate in stated)
    rig.virtual.order("part", "place", rig.rig.part.contact_um, None)
    assert rig.grip() == "gripped"
    assert rig.largest_mN() < LARGEST_MN
