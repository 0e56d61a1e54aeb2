"""A record of an earlier version can be read and replayed to its end."""

import pytest

from pincette.core import plugins
from pincette.engine.replay.recorded import read_record, recorded_epoch, recorded_rig
from pincette.engine.replay.service_alone import replay
from pincette.engine.replay.steps import STEPS
from tests.replay.golden import FOLDER

LAST_BITS = 1e-9
"""Largest relative difference between the exp and log of two processors; see the laws' own
tests."""


@pytest.mark.parametrize("name", STEPS)
def test_a_record_of_an_earlier_version_is_reproduced(name: str) -> None:
    recording = read_record(FOLDER)
    rig, messages = recorded_rig(recording, FOLDER), recorded_epoch(recording)
    found = replay(plugins.load(plugins.SERVICES, name), rig, messages)
    assert found.stopped == ""
    assert found.steps > 300
    if found.first is not None:
        recorded, replayed = found.first.recorded, found.first.replayed
        assert replayed == pytest.approx(recorded, rel=LAST_BITS, abs=LAST_BITS), found.first


def test_the_golden_record_is_small() -> None:
    assert (FOLDER / "job.mcap").stat().st_size < 200_000
