"""Simulated instrument behind a line that may fail."""

import time
from collections.abc import Callable

from pincette.config.script import LONGEST_DELAY_S
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.script.faults import Faults, HungUpError, chance, garbage, lost


class ScriptedLine:
    """Wrapper of an instrument that applies the faults of its line to its answers.

    ``key`` seeds the randomness. In lockstep an answer later than ``patience_s`` is lost; in real
    time (``patience_s`` None) it arrives late.
    """

    def __init__(
        self,
        instrument: Instrument,
        faults: Callable[[], Faults],
        key: str,
        patience_s: float | None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._instrument, self._faults = instrument, faults
        self._key, self._patience_s, self._sleep = key, patience_s, sleep
        self._count = 0

    def idle(self) -> None:
        """Do the idle work of instrument and script; an unplugged instrument continues to run."""
        self._faults()
        self._instrument.idle()

    def answer(self, line: bytes) -> bytes | None:
        """Answer one line if it arrives; raises HungUpError if the port is unplugged."""
        number, self._count = self._count, self._count + 1
        faults = self._faults()
        if not faults:
            return self._instrument.answer(line)
        drawn = chance(self._key, number)
        off = faults.value("off")
        if off is not None or lost(faults.value("intermittent") or 0.0, drawn):
            self._instrument.idle()
            if off and self._patience_s is None:
                raise HungUpError("pulled out by order")
            return None
        reply = self._instrument.answer(line)
        if reply is not None and faults.value("garbage") is not None:
            reply = garbage(drawn)
        return reply if self._in_time(faults.value("slow") or 0.0) else None

    def _in_time(self, delay_s: float) -> bool:
        """Wait until a late answer is due; returns False if the client no longer waits for it."""
        if self._patience_s is not None:
            return delay_s <= self._patience_s
        if delay_s:
            self._sleep(min(delay_s, LONGEST_DELAY_S))
        return True
