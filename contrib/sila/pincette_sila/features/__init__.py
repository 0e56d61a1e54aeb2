"""Feature definitions of this server: the contract with its clients, in our own words."""

from functools import cache
from pathlib import Path
from typing import Any, cast

from sila2.framework import Feature

MICROGRIPPER = "Microgripper-v1_0"
CANCEL_CONTROLLER = "CancelController-v1_0"
SIMULATION_CONTROLLER = "SimulationController-v1_0"
PAUSE_CONTROLLER = "PauseController-v2_0"
SECOND_ARM = "SecondArm-v1_0"
"""Feature that only rigs with two driven arms have."""
ERROR_RECOVERY = "ErrorRecoveryService-v2_0"


def command(name: str, of: str = MICROGRIPPER) -> Any:
    """Return a command of a feature. The library's own lookup does not distinguish commands from
    properties.
    """
    return cast("Any", feature(of))[name]


@cache
def feature(name: str) -> Feature:
    """Read a feature definition. A server must use one object per feature."""
    return Feature(str(Path(__file__).parent / f"{name}.sila.xml"))
