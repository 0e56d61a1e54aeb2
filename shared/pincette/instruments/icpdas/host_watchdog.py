"""The host watchdog of a DCON module: armed at the first sign of life, fed, never cleared unasked.

Where the module hears no heartbeat for ``limit_s`` it goes to its safe value by itself and ignores
what it is told, until the trip is cleared. A trip stays until ``clear``: a voltage that was meant
for before it is stale, and to put it out would move an arm that has been let go.

Where the module has heard a write and not confirmed it, further writes bring no heartbeat until one
is confirmed: a host that cannot get its voltage out must not keep the old one there.
"""

import logging
from typing import Literal

from pincette.instruments.icpdas.dcon import CHECKSUM_BYTES, STATUS, DconModule
from pincette.instruments.protocols import ErrorCode, InstrumentError

HEARTBEAT = b"~**"
TICK_S = 0.1
TRIPPED = 0x04
UNCONFIRMED = ("garbled", "late", "refused")
"""How a write went that the module has heard, or may have heard."""
UNHEARD = ("silent", "late")
"""How a write went that the module may not have heard."""
ZERO_V = 0.003
"""The output stands at 0 V where it is as near as this: two steps of 14 bit over ±10 V."""

State = Literal["off", "waiting", "armed", "unsure", "tripped"]
"""Not wanted; to be armed at the next sign of life; armed; armed, but the module has been silent
and may have lost it, with its supply; tripped."""

_log = logging.getLogger(__name__)


class HostWatchdog:
    """What the host does about it; with ``limit_s`` = 0 nothing is sent."""

    def __init__(self, module: DconModule, limit_s: float) -> None:
        self._module = module
        self._ticks = round(limit_s / TICK_S)
        self._state: State = "waiting" if self._ticks else "off"
        self._unconfirmed = False

    def take_over(self) -> None:
        """Clear a trip of before, and make 0 V the safe value where the output stands there."""
        if self._state == "off":
            return
        # That of a host before this one may still run: the first sign of life is yet to come.
        self._module.tell(HEARTBEAT)
        if self._has_tripped():
            _log.warning("I-7024: its host watchdog had tripped; cleared")
            self._clear()
        found_V = self._module.read_V()
        if abs(found_V) <= ZERO_V:
            self._module.ordered(b"~", b"5%d" % self._module.channel, "safe value")
        else:
            text = "I-7024: the output stands at %+.3f V, so its safe value stays what it is"
            _log.warning(text, found_V)

    def feed_with_write(self) -> None:
        """Send the heartbeat before a write, unless the last one was not confirmed; may raise."""
        if not self._unconfirmed:
            self.feed()

    def feed(self) -> None:
        """Send the heartbeat, and arm the watchdog where that is to be done; may raise.

        A trip that is found on arming is told here, once: nobody has written since, who would know.
        """
        if self._state == "off":
            return
        if self._state in ("unsure", "waiting") and not self.resume():
            raise self._module.tripped("heartbeat")
        try:
            self._module.tell(HEARTBEAT)
        except InstrumentError as error:
            self.learn(error.code)
            raise

    def learn(self, code: ErrorCode | None) -> None:
        """Take note of how a write went; None where it was accepted."""
        if self._state == "off":
            return
        self._unconfirmed = code in UNCONFIRMED
        if code == "tripped":
            self._state = "tripped"
        elif code is None and self._state == "tripped":
            # Somebody else has cleared it, and a module that has tripped is not armed.
            self._state = "waiting"
        elif code in UNHEARD and self._state == "armed":
            self._state = "unsure"

    def resume(self) -> bool:
        """Arm it anew where the line or the module was away; false where there is a trip, which
        stays."""
        if self._state == "off":
            return True
        if self._found_tripped():
            return False
        self._module.ordered(b"~", b"31%02X" % self._ticks, "host watchdog on")
        self._state = "armed"
        # One that ran before may have tripped between the two lines.
        return not self._found_tripped()

    def clear(self) -> None:
        """Clear a trip; raises InstrumentError."""
        if self._state == "off" or not self._has_tripped():
            return
        self._clear()
        self._state = "waiting"

    def leave(self) -> None:
        """Switch it off, so that the output stays as it is; a module that is away is left."""
        if self._state not in ("armed", "unsure"):
            return
        self._state = "off"
        try:
            self._module.ordered(b"~", b"30%02X" % self._ticks, "host watchdog off")
        except InstrumentError as error:
            _log.warning("I-7024: its host watchdog is left on (%s)", error)

    @staticmethod
    def heartbeat_bytes(*, checksum: bool) -> int:
        """Bytes on the line of one heartbeat."""
        return len(HEARTBEAT) + 1 + CHECKSUM_BYTES * checksum

    def _clear(self) -> None:
        # A module may take a watchdog as on while it is tripped, and would trip again at once.
        self._module.ordered(b"~", b"30%02X" % self._ticks, "host watchdog off")
        self._module.ordered(b"~", b"1", "clearing the trip")

    def _found_tripped(self) -> bool:
        if not self._has_tripped():
            return False
        self._state = "tripped"
        _log.warning("I-7024: its host watchdog has tripped; it waits for a reset")
        return True

    def _has_tripped(self) -> bool:
        status = self._module.ordered(b"~", b"0", "status", STATUS)
        if STATUS.fullmatch(status) is None:
            raise InstrumentError(f"I-7024: {status[:40]!r} is no status", "garbled")
        return bool(int(status, 16) & TRIPPED)
