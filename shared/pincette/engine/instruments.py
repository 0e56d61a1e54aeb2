"""The instruments of all arms, read or written one after the other within a tick.

If one instrument fails, the other is not changed: the service decides about both.
"""

from collections.abc import Callable

from msgspec.structs import replace

from pincette.core.faults import Fault
from pincette.core.messages.requests import ExchangeTimes
from pincette.core.service import (
    ArmReading,
    DeviceCommand,
    PutOut,
    ReadBack,
    Reading,
    RefusedError,
    SetVoltage,
)
from pincette.engine.instrument import Device, Instrument, ReadingWatch
from pincette.instruments.line.counts import LineCounts

NAMES = ("the first arm", "the second arm")


class Instruments:
    """Instruments of a runner's service, and the operations on them.

    On a rig with two arms, each fault contains the number of its arm.
    """

    def __init__(
        self,
        device: Device,
        period_s: float,
        watch: ReadingWatch | None,
        counts: LineCounts | None = None,
    ) -> None:
        devices = device if isinstance(device, tuple) else (device,)
        self.counts = LineCounts() if counts is None else counts
        self._watch = watch
        self._arms = tuple(
            Instrument(one, period_s, watch, self.counts, arm=arm)
            for arm, one in enumerate(devices)
        )
        self._several = len(devices) > 1
        self.watched = any(one.watched for one in self._arms)
        """True if an output needs heartbeats."""

    def read(self) -> Reading:
        """Read the sensors of all arms; the age of the first reading then includes the duration of
        the others.
        """
        if not self._several:
            return Reading((self._arms[0].read(),))
        watch = self._watch
        began_s = 0.0 if watch is None else watch.clock()
        first, *others = [self._of_arm(arm, one.read()) for arm, one in enumerate(self._arms)]
        if first.fault is None and watch is not None and (old := watch.too_old(began_s)):
            first = self._of_arm(0, old)
        return Reading((first, *others))

    def put_out(self, order: DeviceCommand) -> Fault | PutOut | None:
        """Send each output its voltage, the second only if the first has succeeded.

        A waveform is only for the first arm; the second arm keeps its voltage.
        """
        read_V: list[float] = []
        for arm, one in enumerate(self._arms):
            reply = one.put_out(order)
            if isinstance(reply, Fault):
                return self._with_arm(arm, reply)
            if reply is not None:
                read_V.append(reply)
            if not isinstance(order, SetVoltage | ReadBack):
                return None
        return PutOut(tuple(read_V)) if read_V else None

    def keep_alive(self, now: float) -> Fault | None:
        """Send each output its heartbeat, but none to the second if the first has failed."""
        for arm, one in enumerate(self._arms):
            if found := one.keep_alive(now):
                return self._with_arm(arm, found)
        return None

    def recover(self) -> PutOut:
        """Clear the trip of each output for a reset, and return the voltages of all."""
        return self._read_V([one.recover for one in self._arms])

    def read_back(self) -> PutOut:
        """Return the outputs' voltages; raises RefusedError if one does not state its own."""
        return self._read_V([one.read_back for one in self._arms])

    def measure(self) -> None:
        """Read each output's voltage a few times."""
        for one in self._arms:
            one.measure()

    @property
    def exchanges(self) -> tuple[ExchangeTimes, ...]:
        """Return the durations of the newest exchanges for each arm.

        Empty until all arms have had one.
        """
        times = [one.exchanges for one in self._arms]
        return tuple([one for one in times if one is not None]) if None not in times else ()

    def capture(self, rate_hz: float) -> None:
        """Begin a buffered acquisition, or end the present one (0 Hz).

        Raises RefusedError if the sensor cannot do this, and on a rig with two arms.
        """
        if not self._several:
            self._arms[0].capture(rate_hz)
        elif rate_hz:
            raise RefusedError(
                f"buffered acquisition at {rate_hz:g} Hz: a rig of two arms has none; load a "
                "motion program without capture_hz"
            )

    def close(self) -> None:
        """Close the devices of all arms."""
        for one in self._arms:
            one.close()

    def _with_arm(self, arm: int, found: Fault) -> Fault:
        return found.with_values(arm=arm + 1) if self._several else found

    def _of_arm(self, arm: int, reading: ArmReading) -> ArmReading:
        if reading.fault is None:
            return reading
        return replace(reading, fault=self._with_arm(arm, reading.fault))

    def _read_V(self, readers: list[Callable[[], float]]) -> PutOut:
        found_V: list[float] = []
        for name, read in zip(NAMES, readers, strict=False):
            try:
                found_V.append(read())
            except RefusedError as error:
                if not self._several:
                    raise
                raise RefusedError(f"{name}: {error}") from error
        return PutOut(tuple(found_V))
