"""The rig file, read and checked."""

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
from pincette.config.tables import ConfigError, Table

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
