"""What the sensor takes from the rig file."""

from dataclasses import dataclass

from pincette.config import ConfigError, RigFile


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """Range of the instrument and its place on the arm, in µm."""

    minimum_um: float
    maximum_um: float
    offset_um: float
    direction: int


def configure(rig: RigFile) -> SensorConfig:
    """Take the sensor's part of a rig file; raises ConfigError."""
    sensor = rig.sensor
    if sensor.minimum_um >= sensor.maximum_um:
        raise ConfigError(
            f"[sensor] minimum_um = {sensor.minimum_um} µm is not below "
            f"maximum_um = {sensor.maximum_um} µm"
        )
    return SensorConfig(sensor.minimum_um, sensor.maximum_um, sensor.offset_um, sensor.direction)
