"""The how-to guide's package: its page shows its files, and once installed it is listed and
opened."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pincette.config import RigFile
from pincette.sim.instruments.dcon import SimulatedI7024
from pincette.sim.wires.wire import serve
from tests.support.example_lds import SimulatedLDS
from tests.support.example_packages import installed, python_path
from tests.support.rigs import demo_rig, rig_toml

FILES = {"toml": "pyproject.toml", "python": "pincette_example_lds.py"}
MOST_LINES = 67
ANY = "socket://127.0.0.1:0"


def text(root: Path, language: str) -> str:
    return (root / "docs/examples/driver" / FILES[language]).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(root: Path) -> str:
    return (root / "docs/how-to/add-a-driver.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which the package is installed."""
    return installed("driver", tmp_path_factory)


def pincette(*words: str | Path, path: Path | None = None) -> subprocess.CompletedProcess[str]:
    environment = dict(os.environ)
    if path is not None:
        environment["PYTHONPATH"] = python_path(path)
    return subprocess.run(
        [sys.executable, "-m", "pincette", *words],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )


def without_simulation(sensor_url: str, output_url: str) -> RigFile:
    rig = demo_rig(
        {
            "sensor": {"driver": "example_lds", "url": sensor_url, "timeout_s": 1.0},
            "output": {"url": output_url, "timeout_s": 1.0},
        }
    )
    sensor = rig.sensor.model_copy(update={"options": {"head": 3}})
    return rig.model_copy(update={"sensor": sensor, "simulation": None})


@pytest.mark.parametrize("language", FILES)
def test_the_page_shows_the_complete_file(root: Path, page: str, language: str) -> None:
    shown = re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert shown[0] == text(root, language)


def test_the_driver_is_short(root: Path) -> None:
    assert sum(len(text(root, language).splitlines()) for language in FILES) <= MOST_LINES


def test_the_driver_is_listed_as_on_the_page(page: str, place: Path) -> None:
    (shown,) = re.findall(r"^```\n(position sensors.*?)^```$", page, re.MULTILINE | re.DOTALL)
    done = pincette("doctor", "--drivers", path=place)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(shown)
    assert "keyence_lkg" in done.stdout
    assert "example_lds" not in pincette("doctor", "--drivers").stdout


def test_a_rig_file_that_names_the_driver_opens_it(place: Path, tmp_path: Path) -> None:
    lds = SimulatedLDS(lambda: 0.0, head=3)
    output = SimulatedI7024(lambda _voltage_V: None, lambda: 0.0)
    with serve(ANY, lds) as sensor_wire, serve(ANY, output) as output_wire:
        rig = without_simulation(sensor_wire.url, output_wire.url)
        file = tmp_path / "rig.toml"
        file.write_text(rig_toml(rig), encoding="utf-8")
        done = pincette("doctor", "--rig", file, "--data", tmp_path, path=place)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"position sensor at {sensor_wire.url}" in done.stdout
    assert lds.asked[0] == b"*IDN?"
    assert set(lds.asked[1:]) == {b"POS3?"}


def test_a_rig_file_with_a_missing_driver_is_reported(tmp_path: Path) -> None:
    rig = without_simulation("socket://127.0.0.1:1", "socket://127.0.0.1:1")
    file = tmp_path / "rig.toml"
    file.write_text(rig_toml(rig), encoding="utf-8")
    done = pincette("run", "sensor", "--rig", file)
    assert done.returncode != 0
    assert "no position sensor 'example_lds' is installed; there are keyence_lkg" in done.stderr
    assert "`pincette doctor --drivers` lists them" in done.stderr
    assert "Traceback" not in done.stderr
