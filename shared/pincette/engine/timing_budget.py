"""Checks whether the instruments of a rig fit into its control period, from the sum of all
durations.
"""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import cast

from pincette.config import ConfigError, Output, RigFile, Sensor
from pincette.control.arm.plant import OutputTiming
from pincette.control.arm.shaping import LAST
from pincette.core import plugins
from pincette.core.messages.requests import ExchangeTimes
from pincette.core.service import AnyService
from pincette.instruments.protocols import Timing

PATIENCE_WAKES = 1.5
"""Number of clock checks for which an actuator's program may wait for a silent sensor. At the third
missed check the actuator concludes that it did not run, and excludes the time from every age.
"""
RESPONSE_TIME_CONSTANTS = 3.0
"""Number of time constants in the response time that the driver of an output states: after this
time it has settled to 5 %."""
EXCHANGE_RESERVE = 1.25
"""Factor by which an exchange may exceed its time on the line, since an instrument needs time
before it replies. With a smaller factor, every reply would be too late.
"""


@dataclass(frozen=True, slots=True)
class Budget:
    """Durations of all parts of a tick; instruments of several arms are used one after another.

    Each tuple has one item per arm, the first arm first.
    """

    period_s: float
    sensors: tuple[Timing, ...]
    """Timing of each sensor, as its driver states it."""
    outputs: tuple[Timing, ...]
    """Timing of each output, as its driver states it."""
    computing_s: float
    parts_s: float = 0.0
    """Time from the first to the last part of a voltage step, in s; 0: it has one part."""
    sensors_measured_s: tuple[float, ...] = ()
    """Measured duration of a reading of each sensor, in s; empty if nothing was measured."""
    outputs_measured_s: tuple[float, ...] = ()
    """Measured duration of an exchange with each output, in s; empty if nothing was measured."""

    @property
    def sensors_s(self) -> tuple[float, ...]:
        """Return the larger of the stated and the measured duration of each reading, in s."""
        return _longest_s(self.sensors, self.sensors_measured_s)

    @property
    def outputs_s(self) -> tuple[float, ...]:
        """Return the larger of the stated and the measured duration of each output's exchange."""
        return _longest_s(self.outputs, self.outputs_measured_s)

    @property
    def sensor_response_s(self) -> float:
        """Return the response time of the slowest sensor, in s."""
        return max(one.response_s for one in self.sensors)

    @property
    def output_response_s(self) -> float:
        """Return the response time of the slowest output, in s."""
        return max(one.response_s for one in self.outputs)

    def measured(
        self, sensors: Sequence[ExchangeTimes], outputs: Sequence[ExchangeTimes]
    ) -> "Budget":
        """Return this budget with the medians of the measured durations added, for each arm."""
        return replace(
            self,
            sensors_measured_s=tuple(one.median_s for one in sensors),
            outputs_measured_s=tuple(one.median_s for one in outputs),
        )

    @property
    def total_s(self) -> float:
        """Return the sum of all parts."""
        return sum(part_s for _, part_s, _ in self._parts())

    @property
    def loop_s(self) -> float:
        """Return the loop's waiting and computing time, in s, without the output's response."""
        return self.total_s - self.output_response_s - self.parts_s

    @property
    def fits(self) -> bool:
        """Return whether the loop keeps the period.

        According to the drivers' statements, a sample, its command and the output's response must
        end within the period. Measured exchanges also contain the time of the machine.
        """
        as_stated = replace(self, sensors_measured_s=(), outputs_measured_s=())
        return as_stated.total_s <= self.period_s and self.loop_s <= self.period_s

    @property
    def bandwidth_hz(self) -> float:
        """Return the highest frequency at which these instruments can identify the arm."""
        return min(one.bandwidth_hz for one in (*self.sensors, *self.outputs))

    def _parts(self) -> tuple[tuple[str, float, str], ...]:
        """Return the name of each part, its duration in s, and the origin of that duration."""
        readings_s, exchanges_s = self.sensors_s, self.outputs_s
        return (
            ("sensor exchange", readings_s[0], _source(self.sensors[0], self.sensors_measured_s)),
            ("sensor response", self.sensor_response_s, ""),
            ("command exchange", exchanges_s[0], _source(self.outputs[0], self.outputs_measured_s)),
            ("output response", self.output_response_s, ""),
            ("parts of a step", self.parts_s, ""),
            ("second arm's exchanges", sum(readings_s[1:]) + sum(exchanges_s[1:]), ""),
            ("computing", self.computing_s, ""),
        )

    def words(self) -> str:
        """Return sum and parts, in ms; for exchanges both the stated and the measured durations."""
        shown = " + ".join(
            f"{name} {1e3 * part_s:.1f}{source}" for name, part_s, source in self._parts() if part_s
        )
        period = f"the control period of {1e3 * self.period_s:g} ms"
        total = f"{shown} = {1e3 * self.total_s:.1f} ms"
        if not self.fits:
            return f"{total}, above {period}"
        if self.total_s <= self.period_s:
            return f"{total}, within {period}"
        return (
            f"{total}; the loop needs {1e3 * self.loop_s:.1f} ms, within {period}, and the "
            "output's response ends in the next one"
        )


def _longest_s(stated: tuple[Timing, ...], measured_s: tuple[float, ...]) -> tuple[float, ...]:
    """Return the larger of the stated and the measured duration for each arm, in s."""
    return tuple(
        max(one.exchange_s, *measured_s[arm : arm + 1], 0.0) for arm, one in enumerate(stated)
    )


def _source(stated: Timing, measured_s: Sequence[float]) -> str:
    """Return the origin of a duration; empty if nothing was measured."""
    for each_s in measured_s:
        if each_s > stated.exchange_s:
            return f" (measured, stated {1e3 * stated.exchange_s:.1f})"
        return f" (stated, measured {1e3 * each_s:.1f})"
    return ""


def budget(rig: RigFile) -> Budget:
    """Return the timing of all instruments as their drivers state it.

    Raises PluginError or ConfigError.
    """
    sensors = tuple(stated(plugins.POSITION_SENSORS, arm.sensor) for arm in rig.arms)
    outputs = tuple(stated(plugins.VOLTAGE_OUTPUTS, arm.output) for arm in rig.arms)
    parts_s = LAST * (rig.shaping_s or 0.0)
    return Budget(rig.rig.period_s, sensors, outputs, rig.realtime.computing_s, parts_s)


def shared_timeout_s(rig: RigFile, services: Iterable[AnyService]) -> float:
    """Return the longest wait for a sensor that does not delay an actuator in the same program, in
    s.
    """
    together = tuple(services)
    looks_s = [one.wake_s(one.configure(rig)) for one in together if one.wake_s is not None]
    reads = any(one.instrument == "position_sensor" for one in together)
    if rig.lockstep or not (looks_s and reads):
        return inf
    # If both sensors of two arms are silent, the waits follow one another.
    limit_s = PATIENCE_WAKES * min(looks_s) / len(rig.arms)
    needed_s = max(stated(plugins.POSITION_SENSORS, arm.sensor).exchange_s for arm in rig.arms)
    if EXCHANGE_RESERVE * needed_s > limit_s:
        raise ConfigError(
            f"[rig] composed = {list(rig.rig.composed)}: an exchange with the sensor takes "
            f"{1000.0 * needed_s:.1f} ms, limit {1000.0 * limit_s / EXCHANGE_RESERVE:.1f} ms "
            "in one program with the actuator, which checks its clock only between "
            "exchanges: make the sensor a program of its own"
        )
    return limit_s


def lets_go_s(rig: RigFile) -> float:
    """Return the earliest time after a heartbeat at which the output may release a part, in s.

    It is the time of the output's own watchdog, as its driver states it. Without a watchdog it
    follows from ``[output] on_silence``: infinite if the hardware holds its value; 0 if it goes to
    a safe value after an unknown time, or if the rig file does not state it.
    """
    return min(_lets_go_s(arm) for arm in rig.arms)


def _lets_go_s(arm: RigFile) -> float:
    try:
        own_s = stated(plugins.VOLTAGE_OUTPUTS, arm.output).lets_go_s
    except (plugins.PluginError, ConfigError):
        own_s = None  # the driver may be installed only on another machine
    if own_s is not None:
        return max(0.0, own_s)
    return inf if arm.output.on_silence == "holds" else 0.0


def stated_output(rig: RigFile) -> OutputTiming:
    """Return the delay and lag of the output according to the drivers; 0 without a driver."""
    try:
        timing = budget(rig)
    except (ConfigError, plugins.PluginError):
        return OutputTiming()
    sensor, output = timing.sensors[0], timing.outputs[0]
    delay_s = sensor.exchange_s + timing.computing_s + output.exchange_s
    return OutputTiming(min(delay_s, rig.rig.period_s), output.response_s / RESPONSE_TIME_CONSTANTS)


def known_budget(rig: RigFile) -> Budget | None:
    """Return the timing of all instruments.

    None if a driver is installed only on another machine.
    """
    try:
        return budget(rig)
    except plugins.PluginError:
        return None


def stated(group: str, settings: Sensor | Output) -> Timing:
    """Return the timing that a driver's module states through its function ``timing``."""
    opener = plugins.load(group, settings.driver)
    timing = vars(sys.modules[opener.__module__]).get("timing")
    if timing is None:
        return Timing(0.0, note=f"{settings.driver} does not state its timing")
    return cast(Timing, timing(settings))
