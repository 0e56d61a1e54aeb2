"""Commands of the DCON protocol to one channel of an analog output module; see ``icpdas_i7024``."""

import logging
import re
from dataclasses import dataclass
from functools import cache

from pincette.instruments.line.matching import ANY_LINE
from pincette.instruments.protocols import InstrumentError, Link

NAME, NOTHING = re.compile(rb".+"), re.compile(rb"")
CONFIGURATION = re.compile(rb"[0-9A-F]{6}")
OUTPUT_TYPES = {
    b"30": "0 to 20 mA",
    b"31": "4 to 20 mA",
    b"32": "0 to +10 V",
    b"33": "-10 to +10 V",
    b"34": "0 to +5 V",
    b"35": "-5 to +5 V",
}
"""Type codes of the output range. The digits of a command do not depend on the range."""
WANTED_TYPE = b"33"
FORMATS = ("engineering units", "% of full scale", "hexadecimal")
"""Data formats by bits 0 and 1 of the format code."""
SLEW_SHIFT, SLEW_MASK = 2, 0x0F
"""Position and mask of the slew rate in the format code (bits 2 to 5); 0 means an immediate change.
"""
VALUE = re.compile(rb"[+-]\d{2}\.\d{3}")
STATUS = re.compile(rb"[0-9A-F]{2}")
NAMED = re.compile(rb"(?![0-9A-F]{2}$|[0-9A-F]{6}$|[+-]\d{2}\.\d{3}$).+")
"""Pattern of an answer with a name or firmware version, which differs from all other answers."""
FORMS: tuple[tuple[re.Pattern[bytes], re.Pattern[bytes]], ...] = (
    (re.compile(rb"\$..[68]\d"), VALUE),
    (re.compile(rb"\$..2"), CONFIGURATION),
    (re.compile(rb"\$..[MF]"), NAMED),
    (re.compile(rb"~..0"), STATUS),
    (re.compile(rb"[$~]..[^*]+"), NOTHING),
)
"""Regular expressions of a command and of its answer after the address."""
SETTING = re.compile(rb"#.*")
SUM = b".."
CONFIRMATIONS = tuple(re.compile(rb"(>|!|\?(..)?)" + end, re.DOTALL) for end in (b"", SUM))
"""Patterns of the answer to a setting, without and with a checksum."""
LINE_BYTES = len(b"#012+05.000") + 1
REPLY_BYTES = len(b">") + 1
CHECKSUM_BYTES = 2
TRIES = 4
"""Largest number of times that a request is sent if the replies belong to other requests, as late
replies do."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class DconModule:
    """One channel of a module at an address.

    Either every line carries a ``checksum`` or none does.
    """

    link: Link
    address: int
    channel: int
    checksum: bool

    def identify(self) -> None:
        """Find a wrong address or a wrong setting of the module before anything moves.

        Raises
        ------
        InstrumentError
            If nothing at the address has a name, or the module is set to another output range,
            a slew rate, or another data format than the driver writes.
        """
        self.ordered(b"$", b"M", "name", NAME)
        reply, head = self._answer(b"$%02X2" % self.address, CONFIGURATION), b"!%02X" % self.address
        if reply == b"?%02X" % self.address:
            text = (
                "I-7024: does not state its configuration; it must be set to -10 to +10 V by hand"
            )
            _log.warning(text)
            return
        if not reply.startswith(head) or CONFIGURATION.fullmatch(reply[len(head) :]) is None:
            raise self._refusal("configuration", reply)
        found = reply[len(head) :]
        self._require_settings(output_type=found[:2], format_code=int(found[4:], 16))

    @staticmethod
    def _require_settings(output_type: bytes, format_code: int) -> None:
        """Raise InstrumentError for the first setting with which the commands would have another
        meaning.
        """
        remedy = "set it with the maker's DCON Utility, then open the module again"
        if output_type != WANTED_TYPE:
            found = OUTPUT_TYPES.get(output_type, "unknown")
            text = (
                f"I-7024: output range {found} (type code {output_type.decode()}), the driver "
                f"needs {OUTPUT_TYPES[WANTED_TYPE]} (type code {WANTED_TYPE.decode()}): {remedy}"
            )
            raise InstrumentError(text, "refused")
        slew = format_code >> SLEW_SHIFT & SLEW_MASK
        if slew:
            text = (
                f"I-7024: slew rate code {slew} (format code {format_code:02X}), the driver needs "
                f"0, an immediate change: {remedy}"
            )
            raise InstrumentError(text, "refused")
        form = format_code & 0x03
        if form:
            found = FORMATS[form] if form < len(FORMATS) else "unknown"
            text = (
                f"I-7024: data format {found} (format code {format_code:02X}), the driver needs "
                f"{FORMATS[0]}: {remedy}"
            )
            raise InstrumentError(text, "refused")

    def put_out(self, voltage_V: float) -> None:
        """Set the output voltage of the channel; raises InstrumentError."""
        head = b"#%02X%d" % (self.address, self.channel)
        reply = self.ask(head + f"{voltage_V:+07.3f}".encode())
        if reply != b">":
            raise self._refusal(f"{voltage_V:+.3f} V", reply)

    def read_V(self) -> float:
        """Return the output voltage of the channel in V; raises InstrumentError."""
        reply = self._answer(b"$%02X8%d" % (self.address, self.channel), VALUE)
        if reply[:3] != b"!%02X" % self.address or VALUE.fullmatch(reply[3:]) is None:
            raise InstrumentError(f"I-7024: {reply[:40]!r} has no voltage", "garbled")
        return float(reply[3:])

    def ordered(
        self, kind: bytes, order: bytes, what: str, form: re.Pattern[bytes] = NOTHING
    ) -> bytes:
        """Send the command ``kind AA order`` and return the answer after ``!AA``.

        Raises InstrumentError.

        ``form`` is the pattern of the answer. The command may be repeated without harm.
        """
        reply = self._answer(kind + b"%02X" % self.address + order, form)
        if not reply.startswith(b"!%02X" % self.address):
            raise self._refusal(what, reply)
        return reply[3:]

    def _answer(self, body: bytes, form: re.Pattern[bytes]) -> bytes:
        """Send a request until its answer arrives, at most ``TRIES`` times; return the last
        answer.
        """
        reply, head = b"", b"!%02X" % self.address
        for _ in range(TRIES):
            reply = self.ask(body)
            own = reply.startswith(head) and form.fullmatch(reply[len(head) :])
            if own or reply == b"?%02X" % self.address:
                break
        return reply

    def ask(self, body: bytes) -> bytes:
        """Exchange one line, with its checksum if used; raises InstrumentError."""
        signed = self.link.exchange(self._signed(body))
        if not self.checksum:
            return signed
        reply, given = signed[:-2], signed[-2:]
        if given != _sum(reply):
            raise InstrumentError(f"I-7024: wrong checksum in {signed[:40]!r}", "garbled")
        return reply

    def tell(self, body: bytes) -> None:
        """Send a line that has no answer; raises InstrumentError."""
        self.link.tell(self._signed(body))

    @staticmethod
    def tripped(what: str) -> InstrumentError:
        """Return the error for commands that a tripped module ignores."""
        text = (
            f"I-7024: {what} ignored: the host watchdog has tripped and the output is at its "
            "safe value; reset the rig, or start the program again"
        )
        return InstrumentError(text, "tripped")

    @staticmethod
    def write_bytes(*, checksum: bool) -> int:
        """Return the number of bytes on the line for one ``put_out``, in both directions."""
        return LINE_BYTES + REPLY_BYTES + 2 * CHECKSUM_BYTES * checksum

    def _signed(self, body: bytes) -> bytes:
        return body + _sum(body) if self.checksum else body

    def _refusal(self, what: str, reply: bytes) -> InstrumentError:
        if reply == b"?":
            return InstrumentError(f"I-7024: {what} refused as out of range", "refused")
        if reply == b"?%02X" % self.address:
            text = f"I-7024: {what} refused as an invalid command; check the module's type and data"
            return InstrumentError(f"{text} format", "refused")
        if reply == b"!":
            return self.tripped(what)
        text = f"I-7024: {what} answered by {reply[:40]!r}, which is unknown"
        return InstrumentError(text, "garbled")


def answers(request: bytes, *, checksum: bool) -> re.Pattern[bytes]:
    """Return the pattern of the answers to a request, refusals included.

    An answer to a setting names neither module nor voltage. Other answers begin with the address
    of the module, and differ in form from command to command.
    """
    body = request[:-CHECKSUM_BYTES] if checksum else request
    if SETTING.fullmatch(body):
        return CONFIRMATIONS[checksum]
    return _answers_of(body, checksum=checksum)


@cache
def _answers_of(body: bytes, *, checksum: bool) -> re.Pattern[bytes]:
    end = SUM if checksum else b""
    for command, form in FORMS:
        if command.fullmatch(body):
            address = re.escape(body[1:3])
            found = form.pattern.replace(b"$", end + b"$")
            return re.compile(b"(!" + address + found + b"|\\?" + address + b")" + end, re.DOTALL)
    return ANY_LINE


def probes(address: int, *, checksum: bool) -> tuple[bytes, ...]:
    """Return requests that change nothing at a module, and whose answers differ from all others."""
    bodies = (b"~%02X0" % address, b"$%02X2" % address, b"$%02XM" % address)
    return tuple(body + _sum(body) if checksum else body for body in bodies)


def _sum(body: bytes) -> bytes:
    total = 0
    for byte in body:
        total += byte
    return b"%02X" % (total % 256)
