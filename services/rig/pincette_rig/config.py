"""What the rig program takes from the rig file."""

from dataclasses import dataclass

from pincette.config import ConfigError, RigFile


@dataclass(frozen=True, slots=True)
class RigConfig:
    """Where the two instruments are offered, and whether the truth is told."""

    sensor_url: str
    output_url: str
    truth: bool


def configure(rig_file: RigFile) -> RigConfig:
    """Take what concerns this program.

    Raises
    ------
    ConfigError
        Where the rig file has no [simulation].
    """
    simulation = rig_file.simulation
    if simulation is None:
        raise ConfigError(
            f"rig {rig_file.rig.name!r} has no [simulation]: its instruments are real, and there "
            "is nothing for `pincette run rig` to do"
        )
    return RigConfig(
        sensor_url=rig_file.sensor.url,
        output_url=rig_file.output.url,
        truth=simulation.truth,
    )
