"""Whether the instruments of a rig fit into its control period, by the sum of all they take."""

import sys
from dataclasses import dataclass
from typing import cast

from pincette import plugins
from pincette.config import Output, RigFile, Sensor
from pincette.instruments.protocols import Timing

COMPUTING_S = 0.002
"""Two samples on the bus and four steps, with room for the slow ones among them."""


@dataclass(frozen=True, slots=True)
class Budget:
    """What a tick takes, part by part."""

    period_s: float
    sensor: Timing
    output: Timing

    @property
    def total_s(self) -> float:
        """Sum of all parts."""
        return (
            self.sensor.exchange_s
            + self.sensor.response_s
            + self.output.exchange_s
            + self.output.response_s
            + COMPUTING_S
        )

    @property
    def fits(self) -> bool:
        """Whether a sample, its command and the output's response end within the period."""
        return self.total_s <= self.period_s

    @property
    def bandwidth_hz(self) -> float:
        """Highest frequency at which the arm can be identified with these instruments."""
        return min(self.sensor.bandwidth_hz, self.output.bandwidth_hz)

    def words(self) -> str:
        """Sum and parts, in ms."""
        parts = {
            "sensor exchange": self.sensor.exchange_s,
            "sensor response": self.sensor.response_s,
            "command exchange": self.output.exchange_s,
            "output response": self.output.response_s,
            "computing": COMPUTING_S,
        }
        shown = " + ".join(f"{name} {1e3 * part:.1f}" for name, part in parts.items() if part)
        relation = "within" if self.fits else "above"
        return (
            f"{shown} = {1e3 * self.total_s:.1f} ms, {relation} the control period of "
            f"{1e3 * self.period_s:g} ms"
        )


def budget(rig: RigFile) -> Budget:
    """Timing of both instruments as their drivers state it; a driver may state nothing.

    Raises
    ------
    PluginError
        Where a driver is not installed.
    ConfigError
        Where an option is unknown or impossible.
    """
    return Budget(
        rig.rig.period_s,
        stated(plugins.POSITION_SENSORS, rig.sensor),
        stated(plugins.VOLTAGE_OUTPUTS, rig.output),
    )


def too_slow(rig: RigFile) -> str:
    """Sum and parts where the instruments do not fit; empty where they do, or nobody can say.

    Nobody can where the driver of the other instrument is installed on another machine alone.
    """
    try:
        needed = budget(rig)
    except plugins.PluginError:
        return ""
    return "" if needed.fits else needed.words()


def stated(group: str, settings: Sensor | Output) -> Timing:
    """Timing that the module of a driver states through a function ``timing`` of the settings."""
    opener = plugins.load(group, settings.driver)
    timing = vars(sys.modules[opener.__module__]).get("timing")
    if timing is None:
        return Timing(0.0, note=f"{settings.driver} does not state its timing")
    return cast(Timing, timing(settings))
