"""The instruments of a rig: opened by their drivers, or simulated within this process."""

import logging
from collections.abc import Callable
from functools import partial
from math import ceil, inf
from typing import TypeVar

from pincette import plugins
from pincette.config import RigFile
from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.protocols import (
    InstrumentError,
    Link,
    PositionSensor,
    VoltageOutput,
)
from pincette.messages import Truth
from pincette.runtime.instrument import Device
from pincette.service import AnyService
from pincette.sim.bench import Bench, Fitted, open_bench
from pincette.sim.script.script import Script, script_of

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


def simulated_bench(rig: RigFile, publish: Callable[[Truth], None]) -> Bench:
    """Set up the simulated rig of this process, with its script where it has one.

    The time of the bench is the lockstep's own, so its clock is never asked.
    """
    return open_bench(
        rig,
        lambda: 0.0,
        lambda seq, x_um, F_mN, u_V: publish(Truth(seq, x_um, F_mN, u_V)),
        scripted(rig),
    )


def scripted(rig: RigFile) -> Script | None:
    """Script of a rig file; None where it has none and takes no orders."""
    simulation = rig.simulation
    wanted = simulation is not None and (simulation.scripts or simulation.script)
    return script_of(rig) if wanted else None


def devices_on(bench: Bench, rig: RigFile) -> dict[str, Device]:
    """Both instruments, as their drivers meet them: the real bytes, over memory."""
    sensor = plugins.load(plugins.POSITION_SENSORS, rig.sensor.driver)
    output = plugins.load(plugins.VOLTAGE_OUTPUTS, rig.output.driver)
    return {
        "sensor": sensor(rig.sensor, _link(bench.fitted["sensor"])),
        "actuator": output(rig.output, _link(bench.fitted["output"])),
    }


def simulated_devices(rig: RigFile, publish: Callable[[Truth], None]) -> dict[str, Device]:
    """Both instruments of a simulated rig in this process, by the name of their service."""
    return devices_on(simulated_bench(rig, publish), rig)


def _link(fitted: Fitted) -> Link:
    """A line to an instrument in this process."""
    if fitted.terminator is not None:
        return MemoryLink(fitted.instrument.answer, fitted.terminator)
    from pincette.instruments.line.rpc_link import RpcMemoryLink

    return RpcMemoryLink(fitted.instrument.answer)
