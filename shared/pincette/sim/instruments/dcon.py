"""ICP DAS I-7024 as seen from its RS-485 line: DCON commands, safe value, host watchdog.

Commands that the analog output manual lists and this module does not know get the answer ``?AA``.
Assumed: a watchdog time of 0 is an invalid command; bit 2 of the status is the trip; a trip
switches the watchdog off; a module without supply loses the trip and the watchdog setting, but
keeps the safe and the power-on values.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field

CHANNELS = 4
LIMIT_V = 10.0
HEARTBEAT = b"~**"
COMMAND = re.compile(rb"([#$~])([0-9A-F]{2})(.*)", re.DOTALL)
DATA = re.compile(rb"[+-]\d{2}\.\d{3}")
WATCHDOG = re.compile(rb"~3([01])([0-9A-F]{2})")
TICK_S = 0.1
TRIPPED, FINE = b"04", b"00"


@dataclass(slots=True)
class _Watchdog:
    """Trips if the host has been silent for ``limit_s`` while it is enabled."""

    enabled: bool = False
    limit_s: float = 0.0
    fed_s: float = 0.0
    tripped: bool = False


@dataclass(slots=True)
class _Channel:
    commanded_V: float = 0.0
    actual_V: float = 0.0
    safe_V: float = 0.0
    power_on_V: float = 0.0


@dataclass(slots=True)
class SimulatedI7024:
    """Four channels, of which ``channel`` drives the plant; ``connect`` adds others.

    Command lines and idle times drive the watchdog, which is common to all channels.
    """

    put_out: Callable[[float], None]
    clock: Callable[[], float]
    address: int = 1
    channel: int = 0
    checksum: bool = False
    configuration: bytes = b"330A00"
    """Answer to ``$AA2``: type code of the output range, line speed, data format."""
    _channels: list[_Channel] = field(
        default_factory=lambda: [_Channel() for _ in range(CHANNELS)], init=False
    )
    _watchdog: _Watchdog = field(default_factory=_Watchdog, init=False)
    _drives: dict[int, Callable[[float], None]] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self._drives[self.channel] = self.put_out

    def connect(self, channel: int, put_out: Callable[[float], None]) -> None:
        """Connect another channel to a function; raises ValueError if it is connected already."""
        if channel in self._drives:
            raise ValueError(f"channel {channel} of module {self.address} already drives an arm")
        self._drives[channel] = put_out

    @property
    def tripped(self) -> bool:
        """Return whether the host watchdog has tripped."""
        return self._watchdog.tripped

    def power_cycle(self) -> None:
        """Simulate an interruption of the supply: each channel starts at its power-on value."""
        self._watchdog = _Watchdog()
        for number, channel in enumerate(self._channels):
            channel.commanded_V = channel.power_on_V
            self._drive(number, channel.power_on_V)

    def idle(self) -> None:
        """Trip the host watchdog if its time has expired."""
        dog = self._watchdog
        if not dog.enabled or dog.tripped or self.clock() - dog.fed_s < dog.limit_s:
            return
        dog.tripped, dog.enabled = True, False
        for number, channel in enumerate(self._channels):
            self._drive(number, channel.safe_V)

    def answer(self, line: bytes) -> bytes | None:
        """Answer one command line; returns None for another address or a wrong checksum."""
        self.idle()
        body = line
        if self.checksum:
            body, given = line[:-2], line[-2:]
            if given != _sum(body):
                return None
        if body == HEARTBEAT:
            self._watchdog.fed_s = self.clock()
            return None
        match = COMMAND.fullmatch(body)
        if match is None or int(match[2], 16) != self.address:
            return None
        reply = self._set(match[3]) if match[1] == b"#" else self._ask(match[1] + match[3])
        if reply is None:
            reply = b"?" + match[2]
        return reply + _sum(reply) if self.checksum else reply

    def _set(self, rest: bytes) -> bytes | None:
        """Execute #AAN(data): output a voltage."""
        number, data = self._number(rest[:1]), rest[1:]
        if number is None or DATA.fullmatch(data) is None:
            return None
        if self._watchdog.tripped:
            return b"!"
        voltage_V = float(data)
        if abs(voltage_V) > LIMIT_V:
            return b"?"
        self._channels[number].commanded_V = voltage_V
        self._drive(number, voltage_V)
        return b">"

    def _ask(self, command: bytes) -> bytes | None:
        """Answer commands after $ and ~; returns None for an unknown command."""
        prefix = b"!%02X" % self.address
        dog = self._watchdog
        if command in (b"$2", b"$M", b"$F", b"~0"):
            status = TRIPPED if dog.tripped else FINE
            known = {b"$2": self.configuration, b"$M": b"7024", b"$F": b"A1.0", b"~0": status}
            return prefix + known[command]
        if command == b"~1":
            dog.tripped = False
            return prefix
        if match := WATCHDOG.fullmatch(command):
            return prefix if self._watch(match[1] == b"1", int(match[2], 16)) else None
        number = self._number(command[2:])
        if number is None or command[:2] not in (b"$6", b"$8", b"~5", b"$4"):
            return None
        channel = self._channels[number]
        if command[:2] == b"~5":
            channel.safe_V = channel.actual_V
            return prefix
        if command[:2] == b"$4":
            channel.power_on_V = channel.actual_V
            return prefix
        shown_V = channel.commanded_V if command[:2] == b"$6" else channel.actual_V
        return prefix + f"{shown_V:+07.3f}".encode()

    def _watch(self, enabled: bool, ticks: int) -> bool:
        """Set the host watchdog; returns False for an invalid setting."""
        if enabled and not ticks:
            return False
        dog = self._watchdog
        dog.enabled, dog.limit_s, dog.fed_s = enabled, ticks * TICK_S, self.clock()
        return True

    def _drive(self, number: int, voltage_V: float) -> None:
        self._channels[number].actual_V = voltage_V
        if number in self._drives:
            self._drives[number](voltage_V)

    @staticmethod
    def _number(text: bytes) -> int | None:
        known = len(text) == 1 and text.isdigit() and int(text) < CHANNELS
        return int(text) if known else None


def _sum(body: bytes) -> bytes:
    """Return the checksum: the sum of the bytes, modulo 256, in two hexadecimal digits."""
    total = 0
    for byte in body:
        total += byte
    return b"%02X" % (total % 256)
