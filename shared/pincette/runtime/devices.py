"""The instruments of a rig, opened by their drivers."""

import logging
from collections.abc import Callable
from functools import partial
from math import ceil, inf
from typing import TypeVar

from pincette import plugins
from pincette.config import RigFile
from pincette.instruments.protocols import InstrumentError, PositionSensor, VoltageOutput
from pincette.runtime.instrument import Device
from pincette.service import AnyService

LOCKSTEP_TIMEOUT_S = 2.0
"""By the clock on the wall, which in lockstep shall end a run that hangs, never a tick."""
TRIES = 3
"""An instrument is opened so often at least: where all programs of a rig start at once, its first
answer may be read late."""

D = TypeVar("D", PositionSensor, VoltageOutput)

_log = logging.getLogger(__name__)


def open_device(service: AnyService, rig: RigFile, at_most_s: float = inf) -> Device:
    """Open the instrument a service moves or reads; None where it has none.

    A sensor is waited for no longer than ``at_most_s``; see ``timing.shared_patience_s``.
    """
    patience = {"timeout_s": LOCKSTEP_TIMEOUT_S} if rig.lockstep else {}
    if service.instrument == "position_sensor":
        patience = patience or {"timeout_s": min(rig.sensor.timeout_s, at_most_s)}
        settings = rig.sensor.model_copy(update=patience)
        sensor = plugins.load(plugins.POSITION_SENSORS, settings.driver)
        times = max(TRIES, ceil(rig.sensor.timeout_s / settings.timeout_s))
        return _insisted(partial(sensor, settings), times)
    if service.instrument == "voltage_output":
        settings = rig.output.model_copy(update=patience)
        output = plugins.load(plugins.VOLTAGE_OUTPUTS, settings.driver)
        return _insisted(partial(output, settings), TRIES)
    return None


def _insisted(open_: Callable[[], D], times: int) -> D:
    """Open an instrument; the last of so many tries may fail.

    A sensor that is waited for shortly in a tick would else be given up as shortly before the
    first.
    """
    for _ in range(times - 1):
        try:
            return open_()
        except InstrumentError as error:
            _log.info("%s; it is tried again", error)
    return open_()
