"""The rig program serves both instruments at the urls of the rig file, and the true state for the
record."""

from pathlib import Path

import pytest

from pincette.config import ConfigError, RigFile, read_rig
from pincette.core.messages import GroundTruth
from pincette.instruments.icpdas_i7024 import open_output
from pincette.instruments.keyence_lkg import open_sensor
from pincette_rig.program import run
from tests.support.rig_program import DeafBus, context_of, offered

pytestmark = pytest.mark.usefixtures("stalls")

DEMO = Path(__file__).parents[2] / "deploy" / "rigs" / "demo.toml"


def _rig_file(tmp_path: Path, pace: str) -> RigFile:
    demo = read_rig(DEMO)
    return demo.model_copy(
        update={
            "rig": demo.rig.model_copy(update={"time": pace}),
            "sensor": demo.sensor.model_copy(update={"url": str(tmp_path / "sensor")}),
            "output": demo.output.model_copy(update={"url": str(tmp_path / "output")}),
        }
    )


@pytest.mark.parametrize("pace", ["lockstep", "real"])
def test_the_rig_program_offers_both_instruments_until_stopped(tmp_path: Path, pace: str) -> None:
    rig, seen = _rig_file(tmp_path, pace), list[float]()
    with offered(rig, tmp_path) as bus:
        sensor, output = open_sensor(rig.sensor), open_output(rig.output)
        for voltage_V in (1.0, 1.0, 0.5):
            output.write_V(voltage_V)
            seen.append(sensor.read_um())
        sensor.close()
        output.close()
    truths = [message for message in bus.told if isinstance(message, GroundTruth)]
    assert [truth.seq for truth in truths] == [0, 1, 2]
    assert [truth.arms[0].voltage_V for truth in truths] == pytest.approx(
        [1.0, 1.0, 0.5], abs=0.0007
    )
    assert [truth.arms[0].x_um for truth in truths[1:]] == pytest.approx(seen[:2], abs=0.2)
    assert bus.names == ["rig"]
    assert bus.closed
    assert not (tmp_path / "sensor").is_symlink()


def test_the_rig_program_needs_a_simulation(tmp_path: Path) -> None:
    real = _rig_file(tmp_path, "real").model_copy(update={"simulation": None})
    with pytest.raises(ConfigError, match=r"rig 'demo' has no \[simulation\]"):
        run(context_of(real, DeafBus(), bool, tmp_path))
