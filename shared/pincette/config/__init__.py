"""The rig file, read and checked."""

from pincette.config.model import IdentifiedFreeResponse, Model, RecordedFreeResponse
from pincette.config.rig_file import Output, RigFile, Sensor, parse_rig, read_rig
from pincette.config.simulation import Simulation
from pincette.config.tables import ConfigError, Table

__all__ = [
    "ConfigError",
    "IdentifiedFreeResponse",
    "Model",
    "Output",
    "RecordedFreeResponse",
    "RigFile",
    "Sensor",
    "Simulation",
    "Table",
    "parse_rig",
    "read_rig",
]
