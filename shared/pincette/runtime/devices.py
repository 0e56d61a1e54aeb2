"""The instruments of a rig: opened by their drivers, or simulated within this process."""

from collections.abc import Callable

from pincette import plugins
from pincette.config import RigFile
from pincette.messages import Truth
from pincette.runtime.node import Device
from pincette.service import AnyService


def open_device(service: AnyService, rig: RigFile) -> Device:
    """Open the instrument a service moves or reads; None where it has none."""
    if service.instrument == "position_sensor":
        return plugins.load(plugins.POSITION_SENSORS, rig.sensor.driver)(rig.sensor)
    if service.instrument == "voltage_output":
        return plugins.load(plugins.VOLTAGE_OUTPUTS, rig.output.driver)(rig.output)
    return None


def simulated_devices(rig: RigFile, truth: Callable[[Truth], None]) -> dict[str, Device]:
    """Placeholder."""
    raise NotImplementedError
