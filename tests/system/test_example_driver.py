"""The how-to guide's driver and its simulated instrument, both external packages, on a whole
rig."""

import csv
import json
import os
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.example_packages import installed, python_path
from tests.support.grips import SHORT, make_ready
from tests.support.rigs import paced_rig
from tests.support.running import RunningRig, running_rig
from tests.support.simulated_lds import registered

NAME = "example_lds"
ROOT = Path(__file__).parents[2]
LONG_S = 90.0
STEP_UM = 0.01
"""Step of the instrument's display, in µm."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    """A rig whose sensor is the example's."""
    place = installed("driver", tmp_path_factory)
    registered(place)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), python_path(place)]))
        demo = paced_rig(SHORT)
        sensor = demo.sensor.model_copy(update={"driver": NAME, "options": {}})
        own = demo.model_copy(update={"sensor": sensor})
        with running_rig(own, tmp_path_factory.mktemp("rig")) as running:
            yield running


def test_the_driver_is_listed_and_grips_from_the_command_line(rig: RunningRig) -> None:
    make_ready(rig, LONG_S)
    url = f"http://{rig.rig.supervisor.host}:{rig.rig.supervisor.port}"
    answers: list[str] = []
    for words in (["doctor", "--drivers", "--json"], ["job", "grip", "--url", url, "--json"]):
        line = [sys.executable, "-m", "pincette", *words]
        done = subprocess.run(line, capture_output=True, text=True, timeout=LONG_S, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        answers.append(done.stdout)
    assert NAME in [driver["name"] for driver in json.loads(answers[0])["sensor"]]
    assert json.loads(answers[1])["state"] == "succeeded"


def test_a_grip_over_rest_uses_the_driver(rig: RunningRig) -> None:
    make_ready(rig, LONG_S)
    name = rig.start_grip()
    assert rig.ended(name, LONG_S)["state"] == "succeeded"
    record = rig.client.get(f"/jobs/{name}/artifacts/samples.csv").raise_for_status()
    rows = csv.DictReader(line for line in record.text.splitlines() if line[:1] != "#")
    steps = [float(row["x_um"]) / STEP_UM for row in rows if row["x_um"]]
    assert len(set(steps)) > 50
    assert max(abs(step - round(step)) for step in steps) < 1e-6
