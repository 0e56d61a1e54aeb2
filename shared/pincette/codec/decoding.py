"""MessagePack maps to messages."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from pincette.codec.kinds import KINDS
from pincette.codec.reading import record_reader
from pincette.codec.unpacking import unpacker
from pincette.messages import Message

M = TypeVar("M", bound=Message)


def decode(kind: type[M], payload: bytes) -> M:
    """Bytes to a message of this kind.

    Raises
    ------
    CodecError
        Where the payload is not exactly such a message.
    """
    return cast(M, _DECODERS[kind](payload))


def _decoder(kind: type) -> Callable[[bytes], Any]:
    unpack, read, name = unpacker(kind), record_reader(kind), kind.__name__
    return lambda payload: read(name, unpack(payload))


_DECODERS = {kind: _decoder(kind) for kind in KINDS}
