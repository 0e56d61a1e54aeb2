"""A bus within one process that carries bytes, so that it refuses what the network refuses."""

from typing import TypeVar

from pincette.bus.memory import MemoryBus
from pincette.core.codec import decode, encode
from pincette.core.messages import Message
from pincette.core.topics import Request

M = TypeVar("M", bound=Message)


def carried(message: M) -> M:
    """The message as it comes over the network; raises CodecError where it would not come."""
    return decode(type(message), encode(message))


class BytesBus(MemoryBus):
    """Whatever is published, asked and answered becomes bytes and a message again."""

    def publish(self, message: Message) -> None:
        super().publish(carried(message))

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        return carried(super().call(question, carried(request), timeout_s))
