"""The instruments of two arms as one: both are read or written within a tick, one after the other.

Where one fails, the other is left as it is: what becomes of both is for the service to say.
"""

from collections.abc import Callable

from msgspec.structs import replace

from pincette.core.faults import Fault
from pincette.core.messages.requests import ExchangeTimes
from pincette.core.service import DeviceCommand, PutOut, ReadBack, Reading, RefusedError, SetVoltage
from pincette.engine.instrument import Both, Device, Instrument, ReadingWatch
from pincette.instruments.line.counts import LineCounts

NAMES = ("the first arm", "the second arm")


class InstrumentPair(Instrument):
    """What a node does with the devices of two arms; each fault says of which arm it is."""

    def __init__(
        self,
        devices: Both,
        period_s: float,
        watch: ReadingWatch | None,
        counts: LineCounts | None = None,
    ) -> None:
        super().__init__(None, period_s, watch, counts)
        self._arms = tuple(Instrument(device, period_s, watch, self.counts) for device in devices)

    def read(self) -> Reading:
        """Read both sensors; the first reading is as old as both took."""
        watch = self._watch
        began_s = 0.0 if watch is None else watch.clock()
        first, second = (_of_arm(arm, one.read()) for arm, one in enumerate(self._arms, start=1))
        if first.fault is None and watch is not None and (old := watch.too_old(began_s)):
            first = _of_arm(1, old)
        return replace(first, second=second)

    def put_out(self, order: DeviceCommand) -> Fault | PutOut | None:
        """Give each output its part of the order, the second only where the first has obeyed.

        A wave is for the first arm alone; the second keeps its voltage.
        """
        first, second = self._arms
        said = first.put_out(order)
        if isinstance(said, Fault):
            return said.with_values(arm=1)
        if isinstance(order, SetVoltage) and order.second_V is not None:
            other = second.put_out(SetVoltage(order.second_V))
        elif isinstance(order, ReadBack):
            other = second.put_out(order)
        else:
            return said
        if isinstance(other, Fault):
            return other.with_values(arm=2)
        if isinstance(said, PutOut) and isinstance(other, PutOut):
            return PutOut(said.voltage_V, other.voltage_V)
        return None

    def keep_alive(self, now: float) -> Fault | None:
        """Say to both outputs that their host lives, or to none where the first has failed."""
        for arm, one in enumerate(self._arms, start=1):
            if found := one.keep_alive(now):
                return found.with_values(arm=arm)
        return None

    def recover(self) -> PutOut:
        """For a reset: clear the trip of either output, and return what both put out."""
        first, second = (_named(arm, one.recover) for arm, one in enumerate(self._arms))
        return PutOut(first.voltage_V, second.voltage_V)

    def read_back(self) -> PutOut:
        """What both put out; raises RefusedError where one does not say."""
        first, second = (_named(arm, one.read_back) for arm, one in enumerate(self._arms))
        return PutOut(first.voltage_V, second.voltage_V)

    def measure(self) -> None:
        """Ask both outputs a few times for their voltages."""
        for one in self._arms:
            one.measure()

    @property
    def exchanges(self) -> tuple[ExchangeTimes, ...]:
        """Durations of the newest exchanges, for each arm; empty until both arms have had one."""
        first, second = (one.exchanges for one in self._arms)
        return (*first, *second) if first and second else ()

    def capture(self, rate_hz: float) -> None:
        """Refuse a buffered acquisition, which would be of one arm alone."""
        if rate_hz:
            raise RefusedError(
                f"buffered acquisition at {rate_hz:g} Hz: a rig of two arms makes none; load a "
                "program without capture_hz"
            )

    def close(self) -> None:
        """Give both devices back."""
        for one in self._arms:
            one.close()


def instrument_of(
    device: Device,
    period_s: float,
    watch: ReadingWatch | None,
    counts: LineCounts | None = None,
) -> Instrument:
    """Return what a node does with the device or the devices that it was given."""
    if isinstance(device, Both):
        return InstrumentPair(device, period_s, watch, counts)
    return Instrument(device, period_s, watch, counts)


def _of_arm(arm: int, reading: Reading) -> Reading:
    if reading.fault is None:
        return reading
    return replace(reading, fault=reading.fault.with_values(arm=arm))


def _named(arm: int, ask: Callable[[], PutOut]) -> PutOut:
    try:
        return ask()
    except RefusedError as error:
        raise RefusedError(f"{NAMES[arm]}: {error}") from error
