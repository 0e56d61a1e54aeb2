"""Messages to MessagePack maps with named fields, and back, with every field checked.

Encoder and decoders are those of msgspec, built once for each message from the types of its fields.
A field that is missing, unknown, duplicated, of the wrong type, not finite or beyond its bound
causes the whole message to be refused.
"""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from msgspec import MsgspecError, structs
from msgspec.msgpack import Decoder, Encoder

from pincette.control.quantities import MAX_TEXT
from pincette.core.codec.refusals import CodecError, read_slowly, short_texts
from pincette.core.messages import Message
from pincette.core.topics import REQUESTS, TOPIC_OF

M = TypeVar("M", bound=Message)

MAX_BYTES = 524_288
"""Size limit of a message, in bytes."""
KINDS = TOPIC_OF.keys() | {
    kind for request in REQUESTS for kind in (request.request, request.reply)
}
"""Every type of message on the bus, from the topics and requests."""
_pack = Encoder().encode
_UNPACK: Mapping[type, Callable[[bytes], Any]] = {kind: Decoder(kind).decode for kind in KINDS}
_TEXTS = {kind: short_texts(kind) for kind in KINDS}
"""Names of the short text fields of each message."""


def encode(message: Message) -> bytes:
    """Return a message as bytes.

    A text field that is too long is truncated, so that the message can be delivered.
    """
    payload = _pack(message)
    if len(payload) <= MAX_TEXT:
        return payload
    cut = _cut(message)
    return payload if cut is message else _pack(cut)


def decode(kind: type[M], payload: bytes) -> M:
    """Return a message of this type from bytes; raises CodecError.

    A payload that this program would encode differently is checked again, since it may contain a
    field twice or lack one, which the decoder does not detect.
    """
    if len(payload) > MAX_BYTES:
        raise CodecError(f"{kind.__name__}: {len(payload)} bytes, limit {MAX_BYTES}")
    try:
        message: M = _UNPACK[kind](payload)
    except (MsgspecError, UnicodeDecodeError, RecursionError) as error:
        read_slowly(kind, payload)
        raise CodecError(f"{kind.__name__}: {error}") from None
    if _pack(message) != payload:
        read_slowly(kind, payload)
    return message


def _cut(message: Message) -> Message:
    long: dict[str, str] = {}
    for name in _TEXTS[type(message)]:
        text = getattr(message, name)
        if len(text) > MAX_TEXT:
            long[name] = text[:MAX_TEXT]
    return structs.replace(message, **long) if long else message
