"""The instruments of a rig: opened by their drivers, or simulated within this process."""

from collections.abc import Callable

from pincette import plugins
from pincette.config import RigFile
from pincette.instruments.memory_link import MemoryLink
from pincette.messages import Truth
from pincette.runtime.node import Device
from pincette.service import AnyService
from pincette.sim.bench import open_bench


def open_device(service: AnyService, rig: RigFile) -> Device:
    """Open the instrument a service moves or reads; None where it has none."""
    if service.instrument == "position_sensor":
        return plugins.load(plugins.POSITION_SENSORS, rig.sensor.driver)(rig.sensor)
    if service.instrument == "voltage_output":
        return plugins.load(plugins.VOLTAGE_OUTPUTS, rig.output.driver)(rig.output)
    return None


def simulated_devices(rig: RigFile, publish: Callable[[Truth], None]) -> dict[str, Device]:
    """Both instruments in this process: the drivers speak the real bytes, over memory.

    The time of the bench is the lockstep's own, so its clock is never asked.
    """
    bench = open_bench(
        rig, lambda: 0.0, lambda seq, x_um, F_mN, u_V: publish(Truth(seq, x_um, F_mN, u_V))
    )
    sensor = plugins.load(plugins.POSITION_SENSORS, rig.sensor.driver)
    output = plugins.load(plugins.VOLTAGE_OUTPUTS, rig.output.driver)
    return {
        "sensor": sensor(rig.sensor, MemoryLink(bench.sensor.answer)),
        "actuator": output(rig.output, MemoryLink(bench.output.answer)),
    }
