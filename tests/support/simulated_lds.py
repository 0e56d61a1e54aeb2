"""The fictitious instrument of docs/how-to/add-a-driver.md, simulated; installed as an external
package."""

from pathlib import Path

from pincette.sim.instruments.fitting import Fitted, Setting, SimulatedDriver
from pincette.sim.instruments.protocol import TERMINATOR
from tests.support.example_lds import SimulatedLDS

ENTRY_POINT = f"[pincette.simulated_instruments]\nexample_lds = {__name__}:EXAMPLE_LDS\n"


def _lds(setting: Setting, _tables: frozenset[str]) -> dict[str, Fitted]:
    sensor = setting.rig_file.sensor
    line = setting.line("sensor", SimulatedLDS(setting.measure_um))
    return {"sensor": Fitted(line, sensor.url, TERMINATOR, setting.baud(sensor))}


EXAMPLE_LDS = SimulatedDriver(frozenset({"sensor"}), _lds)


def registered(folder: Path) -> None:
    """Write the entry points of an installed package into a folder."""
    metadata = folder / "pincette_simulated_lds-1.0.0.dist-info"
    metadata.mkdir()
    text = "Metadata-Version: 2.1\nName: pincette-simulated-lds\nVersion: 1.0.0\n"
    (metadata / "METADATA").write_text(text, encoding="utf-8")
    (metadata / "entry_points.txt").write_text(ENTRY_POINT, encoding="utf-8")
