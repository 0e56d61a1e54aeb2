"""A bus within one process that carries bytes, so that it refuses what the network refuses."""

from typing import TypeVar

from pincette.bus.memory import MemoryBus
from pincette.core.codec import decode, encode
from pincette.core.messages import Message
from pincette.core.topics import Request

M = TypeVar("M", bound=Message)


def carried(message: M) -> M:
    """Return the message as received over the network; raises CodecError if it cannot be encoded
    or decoded."""
    return decode(type(message), encode(message))


class BytesBus(MemoryBus):
    """A bus on which every message, request and reply is encoded to bytes and decoded again."""

    def publish(self, message: Message) -> None:
        super().publish(carried(message))

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        return carried(super().call(question, carried(request), timeout_s))
