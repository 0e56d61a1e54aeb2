"""A supervisor that receives nothing from the bus restarts itself, and a held part stays held."""

import os
from collections.abc import Generator
from pathlib import Path
from time import monotonic, sleep

import httpx
import pytest

from pincette.core.messages import Applied, Telemetry
from tests.support.grips import SHORT, hold, make_ready
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls")

HERE = Path(__file__).parents[1] / "support" / "unheard"
BACK_S = 60.0
"""Longest time until the supervisor is back: a tenth of the usual time without messages, and a
start."""
TRIPPED = ("frozen", "ramping", "latched")


@pytest.fixture(scope="module")
def mute(tmp_path_factory: pytest.TempPathFactory) -> Generator[Path]:
    """While this file exists, the supervisor does not receive its own messages."""
    place = tmp_path_factory.mktemp("mute") / "mute"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PINCETTE_TEST_UNHEARD", str(place))
        before = os.environ.get("PYTHONPATH")
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(HERE), before))))
        yield place


@pytest.fixture(scope="module")
def rig(mute: Path, tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    assert not mute.exists()
    with running_rig(demo_rig(SHORT), tmp_path_factory.mktemp("rig")) as running:
        yield running


def alarms(rig: RunningRig) -> list[str]:
    try:
        found = rig.get("/alarms", cause="supervisor.unheard")["alarms"]
    except httpx.HTTPError:  # it is being restarted
        return []
    return [str(row["words"]) for row in found]


def test_a_supervisor_that_receives_nothing_restarts_itself_once_and_a_part_stays_held(
    rig: RunningRig, seen: Witness, mute: Path, figures: list[str]
) -> None:
    make_ready(rig)
    job = hold(rig, seen)
    process = rig.fleet.members["supervisor"].process
    begun_s = monotonic()
    mute.touch()
    while not alarms(rig):
        assert monotonic() < begun_s + BACK_S
        sleep(0.1)
    mute.unlink()
    until_s = monotonic() + BACK_S
    while True:
        try:
            if rig.job(job)["state"] == "interrupted" and rig.view()["part"] == "held":
                break
        except httpx.HTTPError:
            pass
        assert monotonic() < until_s
        sleep(0.1)
    figures.append(f"supervisor unheard: back after {monotonic() - begun_s:.1f} s")
    assert process.poll() is None, "the restart must keep the process"
    assert not [echo for _, echo in seen.since(Applied, begun_s) if echo.state in TRIPPED]
    assert all(view.held for _, view in seen.since(Telemetry, begun_s))
    release = rig.post("/jobs", {"kind": "release", "autostart": True}).raise_for_status()
    assert rig.ended(release.json()["id"])["state"] == "succeeded"
    assert rig.post("/rigs/demo/estop").status_code == 200
    assert len(alarms(rig)) == 1
