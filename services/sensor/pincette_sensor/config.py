"""Configuration of the sensor from the rig file."""

from dataclasses import dataclass

from pincette.config import ConfigError, RigFile, Sensor


@dataclass(frozen=True, slots=True)
class ArmSensor:
    """Range of one arm's instrument and its position on the arm, in µm."""

    minimum_um: float
    maximum_um: float
    offset_um: float
    direction: int

    def position_um(self, x_um: float) -> float:
        """Return the position of the arm for a reading of the instrument."""
        return self.direction * (x_um - self.offset_um)


@dataclass(frozen=True, slots=True)
class SensorConfig:
    """The sensor of each arm, and the control period."""

    arms: tuple[ArmSensor, ...]
    period_s: float


def configure(rig: RigFile) -> SensorConfig:
    """Read the sensor's settings from a rig file; raises ConfigError."""
    tables = zip(rig.arms, ("sensor", "second.sensor"), strict=False)
    arms = tuple(_of(arm.sensor, table) for arm, table in tables)
    return SensorConfig(arms, rig.rig.period_s)


def _of(sensor: Sensor, table: str) -> ArmSensor:
    if sensor.minimum_um >= sensor.maximum_um:
        raise ConfigError(
            f"[{table}] minimum_um = {sensor.minimum_um} µm is not below "
            f"maximum_um = {sensor.maximum_um} µm"
        )
    return ArmSensor(sensor.minimum_um, sensor.maximum_um, sensor.offset_um, sensor.direction)
