"""Keyence LK-G5000, or LK-G3000, as seen from its RS-232 line: modes, values, settings.

Assumed in addition to ``keyence_commands``: while the mode changes, commands of either mode are
answered as if the mode were wrong; VR,n cancels the zero of output n, which then shows the reading
of the head; KL,1 locks the keys of the panel, including ``press_zero``; a setting takes effect when
it is answered. The controller starts in measuring mode, at 20 µs without averaging.
"""

from collections.abc import Callable

from pincette.sim.instruments.keyence_commands import (
    CODES,
    COMMANDS,
    LONGEST_COMMAND,
    MOST_FOURS,
    OUTPUTS,
    SAME_MODE,
    SAMPLING_S,
    Dialect,
    Fault,
    Refused,
    Unit,
    chosen,
    number,
    value,
)

TERMINATOR = b"\r"


class SimulatedKeyence:
    """Controller whose outputs all show ``measure()``, in µm; None is an invalid reading.

    ``clock`` is used for the duration of mode changes, and must advance without calls to this
    object. ``set_averaging`` is called with the averaging time of output 1 whenever it changes.
    Before each n-th answer (``unsolicited_every``, 0: never) TG,01 is sent.
    """

    def __init__(
        self,
        measure: Callable[[], float | None],
        unit: Unit = "um",
        *,
        dialect: Dialect = "LK-G5000",
        clock: Callable[[], float] = lambda: 0.0,
        mode_change_s: float = 0.0,
        set_averaging: Callable[[float], None] | None = None,
        unsolicited_every: int = 0,
    ) -> None:
        self.trouble: Fault | None = None
        """Fault of the instrument, such as "timeout"; measuring commands are answered with it."""
        self._measure = measure
        self._unit: Unit = unit
        self._dialect: Dialect = dialect
        self._clock = clock
        self._mode_change_s = mode_change_s
        self._set_averaging = set_averaging
        self._unsolicited_every = unsolicited_every
        self._measuring = True
        self._changed_at_s = float("-inf")
        self._locked = False
        self._zero_um = dict.fromkeys(range(1, OUTPUTS[dialect] + 1), 0.0)
        self._sampling_s = SAMPLING_S[3]
        self._averaged = 1
        self._answers = 0

    @property
    def averaging_s(self) -> float:
        """Return the averaging time of output 1, in s."""
        return self._sampling_s * self._averaged

    def press_zero(self) -> None:
        """Press the zero key of the panel: every output then shows the change since this moment."""
        x_um = self._measure()
        if not self._locked and x_um is not None:
            self._zero_um = dict.fromkeys(self._zero_um, x_um)

    def idle(self) -> None:
        """Do nothing: this instrument sends nothing between two commands.

        An unsolicited line is sent together with an answer, just before it.
        """

    def answer(self, line: bytes) -> bytes | None:
        """Answer one command line; commands are case-insensitive."""
        command, *fields = line.strip().upper().split(b",")
        if not command:
            return None
        try:
            reply = self._carry_out(command, fields, len(line))
        except Refused as refused:
            reply = b"ER," + command + b"," + CODES[self._dialect][refused.fault]
        self._answers += 1
        every = self._unsolicited_every
        if not every or self._answers % every or not self._measuring:
            return reply
        return b"TG,01," + self._shown(1) + TERMINATOR + reply

    def _carry_out(self, command: bytes, fields: list[bytes], length: int) -> bytes:
        known = COMMANDS[self._dialect].get(command)
        if known is None:
            raise Refused("unknown")
        if length > LONGEST_COMMAND:
            raise Refused("length")
        if not known.least <= len(fields) <= known.most:
            raise Refused("count")
        if known.measuring is None:
            return self._change_mode(command)
        if self._changing() or known.measuring != self._measuring:
            raise Refused("mode")
        if command == b"SW":
            return self._set_up(fields)
        if command == b"VR":
            self._zero_um[number(fields[0], 1, len(self._zero_um))] = 0.0
            return command
        if command == b"KL":
            self._locked = bool(number(fields[0], 0, 1))
            return command
        if self.trouble is not None:
            raise Refused(self.trouble)
        shown = [self._shown(output) for output in chosen(command, fields, self._dialect)]
        return b",".join([command, *fields, *shown])

    def _change_mode(self, command: bytes) -> bytes:
        measuring = command == b"R0"
        if measuring == self._measuring:
            return b"ER," + command + b"," + SAME_MODE
        self._measuring, self._changed_at_s = measuring, self._clock()
        return command

    def _changing(self) -> bool:
        return self._clock() - self._changed_at_s < self._mode_change_s

    def _set_up(self, fields: list[bytes]) -> bytes:
        what, *rest = fields
        if what not in (b"CA", b"OC"):
            raise Refused("parameter")
        if len(rest) != (1 if what == b"CA" else 3):
            raise Refused("count")
        before_s = self.averaging_s
        if what == b"CA":
            self._sampling_s = SAMPLING_S[number(rest[0], 0, len(SAMPLING_S) - 1)]
        else:
            number(rest[1], 0, 0)
            averaged = 4 ** number(rest[2], 0, MOST_FOURS)
            if number(rest[0], 1, len(self._zero_um)) == 1:
                self._averaged = averaged
        if self._set_averaging is not None and self.averaging_s != before_s:
            self._set_averaging(self.averaging_s)
        return b"SW," + what

    def _shown(self, output: int) -> bytes:
        x_um = self._measure()
        return value(None if x_um is None else x_um - self._zero_um[output], self._unit)
