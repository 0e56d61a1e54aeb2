"""Host watchdog of a DCON module: armed at the first heartbeat, never cleared automatically.

If the module receives no heartbeat for ``limit_s`` it goes to its safe value and ignores commands
until the trip is cleared. A trip stays until ``clear``: a voltage that was computed before the trip
is outdated, and applying it would move an arm that has been released.

If the module has received a write but not confirmed it, further writes send no heartbeat until one
is confirmed: a host that cannot set a voltage must not keep the old one applied.
"""

import logging
from typing import Literal

from pincette.instruments.icpdas.dcon import CHECKSUM_BYTES, STATUS, DconModule
from pincette.instruments.protocols import ErrorCode, InstrumentError

HEARTBEAT = b"~**"
TICK_S = 0.1
TRIPPED = 0x04
UNCONFIRMED = ("garbled", "late", "refused")
"""Error codes of a write that the module has received, or may have received."""
UNHEARD = ("silent", "late")
"""Error codes of a write that the module may not have received."""
ZERO_V = 0.003
"""Tolerance of 0 V at the output: two steps of 14 bit over ±10 V."""

State = Literal["off", "waiting", "armed", "unsure", "tripped"]
"""State of the watchdog.

``off``: not used; ``waiting``: to be armed at the next heartbeat; ``armed``; ``unsure``: armed, but
the silent module may have lost the setting with its supply; ``tripped``.
"""

_log = logging.getLogger(__name__)


class HostWatchdog:
    """Host side of the watchdog; sends nothing if ``limit_s`` is 0."""

    def __init__(self, module: DconModule, limit_s: float) -> None:
        self._module = module
        self._ticks = round(limit_s / TICK_S)
        self._state: State = "waiting" if self._ticks else "off"
        self._unconfirmed = False

    def take_over(self) -> None:
        """Clear an earlier trip, and make 0 V the safe value if the output is at 0 V."""
        if self._state == "off":
            return
        # The watchdog of an earlier host may still run; this heartbeat keeps it from tripping.
        self._module.tell(HEARTBEAT)
        if self._has_tripped():
            _log.warning("I-7024: its host watchdog had tripped; cleared")
            self._clear()
        found_V = self._module.read_V()
        if abs(found_V) <= ZERO_V:
            self._module.ordered(b"~", b"5%d" % self._module.channel, "safe value")
        else:
            text = "I-7024: the output stands at %+.3f V, so its safe value is not changed"
            _log.warning(text, found_V)

    def feed_with_write(self) -> None:
        """Send the heartbeat before a write, unless the last write was not confirmed; may raise."""
        if not self._unconfirmed:
            self.feed()

    def feed(self) -> None:
        """Send the heartbeat, and arm the watchdog if that is due; may raise.

        A trip that is detected on arming is reported here once, since no write could have reported
        it.
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
        """Update the state from the result of a write: its error code, or None if it was
        accepted.
        """
        if self._state == "off":
            return
        self._unconfirmed = code in UNCONFIRMED
        if code == "tripped":
            self._state = "tripped"
        elif code is None and self._state == "tripped":
            # Another program has cleared the trip, since a tripped module accepts no write. Arm the
            # watchdog again.
            self._state = "waiting"
        elif code in UNHEARD and self._state == "armed":
            self._state = "unsure"

    def resume(self) -> bool:
        """Arm the watchdog again after the line or the module was lost.

        Returns False if the watchdog has tripped; the trip stays.
        """
        if self._state == "off":
            return True
        if self._found_tripped():
            return False
        self._module.ordered(b"~", b"31%02X" % self._ticks, "host watchdog on")
        self._state = "armed"
        # An earlier watchdog may have tripped between the check above and the arming.
        return not self._found_tripped()

    def clear(self) -> None:
        """Clear a trip; raises InstrumentError."""
        if self._state == "off" or not self._has_tripped():
            return
        self._clear()
        self._state = "waiting"

    def leave(self) -> None:
        """Switch the watchdog off so that the output keeps its voltage.

        Ignores an absent module.
        """
        if self._state not in ("armed", "unsure"):
            return
        self._state = "off"
        try:
            self._module.ordered(b"~", b"30%02X" % self._ticks, "host watchdog off")
        except InstrumentError as error:
            _log.warning("I-7024: its host watchdog stays on (%s)", error)

    @staticmethod
    def heartbeat_bytes(*, checksum: bool) -> int:
        """Return the number of bytes on the line for one heartbeat."""
        return len(HEARTBEAT) + 1 + CHECKSUM_BYTES * checksum

    def _clear(self) -> None:
        # A tripped module may accept a watchdog, and would trip again at once.
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
            raise InstrumentError(f"I-7024: {status[:40]!r} is not a status", "garbled")
        return bool(int(status, 16) & TRIPPED)
