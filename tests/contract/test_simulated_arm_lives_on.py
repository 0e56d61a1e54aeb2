"""The real rig program is killed and started again: it simulates the same arm."""

import signal
from contextlib import closing
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.cli.up import forget_arm
from pincette.config import RigFile
from pincette.engine.fleet import Fleet
from pincette.instruments.icpdas_i7024 import open_output
from pincette.instruments.keyence_lkg import open_sensor
from tests.support.rigs import demo_rig, rig_toml

HIGH_V = 2.5
PATIENCE_S = 30.0


def remanence_um(rig: RigFile) -> float:
    """Position of the arm at 0 V, by the bytes of its sensor."""
    with closing(open_sensor(rig.sensor)) as sensor:
        readings_um = [sensor.read_um() for _ in range(20)]
    return sum(readings_um) / len(readings_um)


def stroke(rig: RigFile) -> None:
    """Move the free arm to a high voltage and back."""
    with closing(open_output(rig.output)) as output:
        for voltage_V in (HIGH_V, 0.0):
            output.write_V(voltage_V)
            sleep(0.2)


def kill(fleet: Fleet) -> None:
    """Kill the rig program."""
    fleet.signal("rig", signal.SIGKILL)
    fleet.members["rig"].process.wait(PATIENCE_S)


def start_again(fleet: Fleet) -> None:
    """Start the rig program again."""
    assert fleet.revive("rig").ready.wait(PATIENCE_S)


def test_the_simulated_arm_keeps_its_state_after_a_kill_and_option_new_arm_discards_the_state(
    tmp_path: Path,
) -> None:
    rig = demo_rig({"simulation": {"bead": False}})
    path, data = tmp_path / "rig.toml", tmp_path / "data"
    path.write_text(rig_toml(rig), encoding="utf-8")
    fleet = Fleet(rig, path, data, lambda _name, _line: None)
    try:
        fleet.start(["router", "rig"])
        new_um = remanence_um(rig)
        stroke(rig)
        before_um = remanence_um(rig)
        assert before_um - new_um > 1.0
        written, deadline = rig.simulated_arm(data).stat().st_mtime_ns, monotonic() + PATIENCE_S
        while rig.simulated_arm(data).stat().st_mtime_ns == written:
            assert monotonic() < deadline
            sleep(0.05)
        kill(fleet)
        start_again(fleet)
        after_um = remanence_um(rig)
        assert 0.5 * (before_um - new_um) < after_um - new_um < 1.2 * (before_um - new_um)
        assert not list(rig.simulated_arm(data).parent.glob("*.part"))
        kill(fleet)
        forget_arm(rig, data)
        start_again(fleet)
        assert remanence_um(rig) == pytest.approx(new_um, abs=0.1)
    finally:
        fleet.down()
