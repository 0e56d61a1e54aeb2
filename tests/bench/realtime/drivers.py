"""Drivers for the demo rig's instruments that state no durations, so the instruments may be as fast
as the simulated ones.

Only the programs of a bench find them, through a folder on their path.
"""

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from pincette.config import Output, Sensor
from pincette.instruments import icpdas_i7024, keyence_lkg
from pincette.instruments.protocols import PositionSensor, VoltageOutput

PATH = "PYTHONPATH"
SENSOR, OUTPUT = "unhurried_sensor", "unhurried_output"
ENTRIES = f"""\
[pincette.position_sensors]
{SENSOR} = {__name__}:open_sensor

[pincette.voltage_outputs]
{OUTPUT} = {__name__}:open_output
"""


def open_sensor(settings: Sensor) -> PositionSensor:
    """Open a laser whose bytes take no time."""
    return keyence_lkg.open_sensor(settings)


def open_output(settings: Output) -> VoltageOutput:
    """Open an output that responds at once."""
    return icpdas_i7024.open_output(settings)


@contextmanager
def registered(folder: Path) -> Generator[None]:
    """Write a distribution with these drivers into a folder, where newly started programs find
    it."""
    place = folder / "pincette_bench-0.dist-info"
    place.mkdir()
    (place / "METADATA").write_text("Metadata-Version: 2.1\nName: pincette-bench\nVersion: 0\n")
    (place / "entry_points.txt").write_text(ENTRIES)
    before = os.environ.get(PATH)
    os.environ[PATH] = os.pathsep.join([str(folder), *([before] if before else [])])
    try:
        yield
    finally:
        os.environ.pop(PATH)
        if before is not None:
            os.environ[PATH] = before
