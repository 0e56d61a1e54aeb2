"""The rig file, read and validated. Submodules are imported when one of their names is first
used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pincette.config.calibration import Calibration, calibrated, parse_calibration
    from pincette.config.instruments import Output, Sensor
    from pincette.config.model import (
        FreeResidual,
        IdentifiedFreeResponse,
        Model,
        RecordedFreeResponse,
    )
    from pincette.config.reading import parse_rig, parse_rig_json, read_rig
    from pincette.config.rig_file import RigFile
    from pincette.config.simulation import Simulation
    from pincette.config.tables import Table
    from pincette.config.toml_file import ConfigError

__all__ = [
    "Calibration",
    "ConfigError",
    "FreeResidual",
    "IdentifiedFreeResponse",
    "Model",
    "Output",
    "RecordedFreeResponse",
    "RigFile",
    "Sensor",
    "Simulation",
    "Table",
    "calibrated",
    "parse_calibration",
    "parse_rig",
    "parse_rig_json",
    "read_rig",
]
PLACES = {
    "calibration": ("Calibration", "calibrated", "parse_calibration"),
    "instruments": ("Output", "Sensor"),
    "model": ("FreeResidual", "IdentifiedFreeResponse", "Model", "RecordedFreeResponse"),
    "reading": ("parse_rig", "parse_rig_json", "read_rig"),
    "rig_file": ("RigFile",),
    "simulation": ("Simulation",),
    "tables": ("Table",),
    "toml_file": ("ConfigError",),
}
"""Modules and the names that they define. Importing all of them takes a third of a second, but the
help text of a command needs only the laws or the commands of a simulated rig.
"""


def __getattr__(name: str) -> Any:
    for module, names in PLACES.items():
        if name in names:
            found = getattr(import_module(f"{__name__}.{module}"), name)
            globals()[name] = found
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
