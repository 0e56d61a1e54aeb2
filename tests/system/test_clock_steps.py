"""The wall clock of every program is set by an hour while a part is held: only the record
notices, and states it."""

import json
import os
from collections.abc import Generator
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.core.messages import Applied, Telemetry
from pincette.records import folder, mcap_reading
from pincette.records.mcap_file import NAME
from tests.support.grips import SHORT, hold, make_ready
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls")

SET_CLOCK = Path(__file__).parents[1] / "support" / "set_clock"
HOUR_S, SETTLED_S = 3600.0, 0.6
TRIPPED = ("frozen", "ramping", "latched")


@pytest.fixture(scope="module")
def clock(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("clock") / "shift"


@pytest.fixture(scope="module")
def rig(clock: Path, tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PINCETTE_TEST_CLOCK", str(clock))
        patch.setenv(
            "PYTHONPATH", os.pathsep.join([str(SET_CLOCK), os.environ.get("PYTHONPATH", "")])
        )
        with running_rig(demo_rig(SHORT), tmp_path_factory.mktemp("rig")) as running:
            yield running


def set_by(clock: Path, shift_s: float) -> None:
    """Set the clock of every program; the file is replaced atomically, since they read it
    meanwhile."""
    part = clock.with_suffix(".part")
    part.write_text(repr(shift_s), encoding="utf-8")
    part.replace(clock)
    sleep(SETTLED_S)


def test_a_clock_step_of_an_hour_changes_no_timing_and_is_recorded(
    rig: RunningRig, seen: Witness, clock: Path
) -> None:
    set_by(clock, 0.0)
    make_ready(rig)
    job = hold(rig, seen)
    begun_s = monotonic()
    for shift_s in (HOUR_S, -HOUR_S, 0.0):
        set_by(clock, shift_s)
    spent_s = monotonic() - begun_s
    views = [view for _, view in seen.since(Telemetry, begun_s)]
    echoes = [echo for _, echo in seen.since(Applied, begun_s)]
    # The number of ticks is that of the time passed by the monotonic clock.
    ticks, period_s = views[-1].seq - views[0].seq, rig.rig.rig.period_s
    slack_s = 0.1 * spent_s
    assert ticks * period_s == pytest.approx(spent_s, abs=slack_s)
    assert {view.phase for view in views} == {"hold"}
    assert not [echo for echo in echoes if echo.state in TRIPPED]
    assert rig.job(job)["state"] == "running"
    rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
    ended = rig.ended(job)
    assert ended["state"] == "succeeded", ended["cause"]
    assert ended["record_complete"], ended["record_detail"]
    where = Path(ended["record"])
    content = json.loads((where / folder.MANIFEST).read_text(encoding="utf-8"))["detail"]
    steps = [f"set by {step_s:+.1f} s" for step_s in (HOUR_S, -2.0 * HOUR_S, HOUR_S)]
    assert [step for step in steps if step in content] == steps
    assert ended["record_detail"] == content
    # The record's own times continue evenly: no sample is an hour from the next one.
    samples = mcap_reading.read(where / NAME).messages
    assert len([one for one in samples if isinstance(one, Telemetry)]) > ticks
