"""Lines of the DCON protocol to one channel of an analog output module; see ``icpdas_i7024``."""

import re
from dataclasses import dataclass

from pincette.instruments.protocols import InstrumentError, Link

NAME, NOTHING = re.compile(rb".+"), re.compile(rb"")
VALUE = re.compile(rb"[+-]\d{2}\.\d{3}")
LINE_BYTES = len(b"#012+05.000") + 1
REPLY_BYTES = len(b">") + 1
CHECKSUM_BYTES = 2
TRIES = 4
"""How often a question is asked whose answer is none of its own: a slow module's late one."""


@dataclass(frozen=True, slots=True)
class DconModule:
    """One channel of a module at an address; ``checksum`` is carried by each line, or by none."""

    link: Link
    address: int
    channel: int
    checksum: bool

    def identify(self) -> None:
        """Ask for the module's name, so that a wrong address is found before anything moves."""
        self.ordered(b"$", b"M", "name", NAME)

    def put_out(self, voltage_V: float) -> None:
        """Set the channel; raises InstrumentError."""
        head = b"#%02X%d" % (self.address, self.channel)
        reply = self.ask(head + f"{voltage_V:+07.3f}".encode())
        if reply != b">":
            raise self._refusal(f"{voltage_V:+.3f} V", reply)

    def read_V(self) -> float:
        """Return what the channel puts out; raises InstrumentError."""
        reply = self._answer(b"$%02X8%d" % (self.address, self.channel), VALUE)
        if reply[:3] != b"!%02X" % self.address or VALUE.fullmatch(reply[3:]) is None:
            raise InstrumentError(f"I-7024: {reply[:40]!r} carries no voltage", "garbled")
        return float(reply[3:])

    def ordered(
        self, kind: bytes, order: bytes, what: str, form: re.Pattern[bytes] = NOTHING
    ) -> bytes:
        """Send ``kind AA order``, answered by ``!AA`` and what is returned; may raise.

        ``form`` is that of the answer. What is ordered may be said again without harm.
        """
        reply = self._answer(kind + b"%02X" % self.address + order, form)
        if not reply.startswith(b"!%02X" % self.address):
            raise self._refusal(what, reply)
        return reply[3:]

    def _answer(self, body: bytes, form: re.Pattern[bytes]) -> bytes:
        """Ask until the answer is one to this; the last one, whatever it is."""
        reply, head = b"", b"!%02X" % self.address
        for _ in range(TRIES):
            reply = self.ask(body)
            own = reply.startswith(head) and form.fullmatch(reply[len(head) :])
            if own or reply == b"?%02X" % self.address:
                break
        return reply

    def ask(self, body: bytes) -> bytes:
        """Exchange one line, with its checksum where there is one; raises InstrumentError."""
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
        """The error of what a module that has tripped ignores."""
        text = (
            f"I-7024: {what} ignored: the host watchdog has tripped and the output is at its "
            "safe value; reset the rig, or start the program anew"
        )
        return InstrumentError(text, "tripped")

    @staticmethod
    def write_bytes(*, checksum: bool) -> int:
        """Bytes on the line of one ``put_out``, in both directions."""
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
        text = f"I-7024: {what} answered by {reply[:40]!r}, which means nothing here"
        return InstrumentError(text, "garbled")


def _sum(body: bytes) -> bytes:
    total = 0
    for byte in body:
        total += byte
    return b"%02X" % (total % 256)
