"""A rig that cannot start is refused with the cause and a remedy; no program is left running."""

import socket
from pathlib import Path

import pytest

from pincette.config import RigFile
from tests.support.commands import assert_nothing_is_left, pincette, pincette_here
from tests.support.grips import make_ready
from tests.support.rigs import Tree, demo_rig, rig_toml
from tests.support.running import RunningRig


@pytest.fixture
def rig(paced: RunningRig) -> RunningRig:
    make_ready(paced)
    return paced


def test_a_second_rig_with_the_same_rig_file_is_refused(rig: RunningRig, tmp_path: Path) -> None:
    done = pincette_here("up", "--rig", rig.path, "--data", tmp_path)
    assert done.returncode == 1
    assert f"router: 127.0.0.1:{rig.rig.bus.port} is in use" in done.stderr
    assert "running already" in done.stderr
    assert rig.view()["can_start"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (None, ["No such file or directory", "--rig"]),
        ("[rig\n", ["is not TOML"]),
        ('[law]\nKp = 1.0\n[rig]\nname = "r"\n', ["law.Kp = 1.0", "no such gain"]),
        ("[bus]\nport = 80\n", ["bus.port = 80", "1024"]),
        ('[rig]\nname = "r"\nperiod_s = "fast"\n', ["rig.period_s = 'fast'", "number"]),
        ('[rig]\nname = "r"\nperiod_s = nan\n', ["rig.period_s = nan"]),
    ],
)
def test_a_bad_rig_file_is_refused(tmp_path: Path, change: str | None, words: list[str]) -> None:
    path = tmp_path / "bad.toml"
    if change is not None:
        path.write_text(change, encoding="utf-8")
    done = pincette_here("up", "--rig", path, "--data", tmp_path)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert [word for word in [str(path), *words] if word not in done.stderr] == []


def test_limits_in_the_wrong_order_are_refused(tmp_path: Path) -> None:
    text = rig_toml(demo_rig()).replace("voltage_max_V = 4.0", "voltage_max_V = -2.0")
    path = tmp_path / "crossed.toml"
    path.write_text(text, encoding="utf-8")
    done = pincette_here("up", "--rig", path, "--data", tmp_path)
    assert done.returncode == 1
    assert "voltage_min_V = -1.0 V is not below voltage_max_V = -2.0 V" in done.stderr


def cannot_start(rig: RigFile, folder: Path) -> str:
    """Return the message of `pincette up` for a rig that cannot start; nothing of it is left."""
    path = folder / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    done = pincette("up", "--rig", path, "--data", folder / "data")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert_nothing_is_left(rig, path)
    return done.stderr


def test_an_instrument_that_does_not_answer_is_reported(tmp_path: Path) -> None:
    # The rig is not simulated: nothing listens where its instruments should be. Which program gives
    # up first is random.
    rig = demo_rig().model_copy(update={"simulation": None})
    output = cannot_start(rig, tmp_path)
    urls = {"sensor": rig.sensor.url, "actuator": rig.output.url}
    named = [name for name in urls if f"{name} did not start" in output]
    assert named
    assert [url for name, url in urls.items() if (name in named) != (url in output)] == []
    assert "refused" in output


@pytest.mark.parametrize("program", ["router", "actuator", "supervisor"])
def test_a_busy_port_is_reported(tmp_path: Path, program: str) -> None:
    rig = demo_rig()
    offset = {"router": 0, "actuator": 4, "supervisor": 7}[program]
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    with socket.create_server(("127.0.0.1", rig.bus.port + offset)):
        done = pincette_here("up", "--rig", path, "--data", tmp_path / "data")
    assert done.returncode == 1
    assert f"{program}: 127.0.0.1:{rig.bus.port + offset} is in use" in done.stderr
    assert_nothing_is_left(rig, path)


def test_a_missing_supervisor_is_reported() -> None:
    done = pincette_here("job", "grip", "--url", f"http://127.0.0.1:{demo_rig().bus.port}")
    assert done.returncode == 3
    assert "no supervisor answers at http://127.0.0.1:" in done.stderr
    assert "pincette up" in done.stderr


def test_a_program_that_fails_to_start_stops_the_others(tmp_path: Path) -> None:
    changes: Tree = {"sensor": {"driver": "no_such_sensor"}}
    output = cannot_start(demo_rig(changes), tmp_path)
    assert "no_such_sensor" in output
    assert "keyence_lkg" in output
