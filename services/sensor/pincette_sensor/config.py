"""What the sensor takes from the rig file."""

from dataclasses import dataclass, replace

from pincette.config import ConfigError, RigFile, Sensor


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """Range of the instrument and its place on the arm, in µm."""

    minimum_um: float
    maximum_um: float
    offset_um: float
    direction: int
    second: "SensorConfig | None" = None
    """Of the second arm's instrument, where there is one."""


def configure(rig: RigFile) -> SensorConfig:
    """Take the sensor's part of a rig file; raises ConfigError."""
    first = _of(rig.sensor, "sensor")
    if rig.second is None:
        return first
    return replace(first, second=_of(rig.second.sensor, "second.sensor"))


def _of(sensor: Sensor, table: str) -> SensorConfig:
    if sensor.minimum_um >= sensor.maximum_um:
        raise ConfigError(
            f"[{table}] minimum_um = {sensor.minimum_um} µm is not below "
            f"maximum_um = {sensor.maximum_um} µm"
        )
    return SensorConfig(sensor.minimum_um, sensor.maximum_um, sensor.offset_um, sensor.direction)
