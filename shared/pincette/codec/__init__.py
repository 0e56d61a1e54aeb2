"""Messages to MessagePack maps with named fields, and back, with every field checked.

Encoder and decoder are built once for each message from its annotations; nothing is looked up by
reflection while samples travel. A field that is missing, unknown, there twice, of the wrong type,
not finite or beyond its bound refuses the whole message.
"""

from pincette.codec.bounds import MAX_BYTES, MAX_DOCUMENT, MAX_ITEMS, MAX_TEXT
from pincette.codec.decoding import decode
from pincette.codec.encoding import encode
from pincette.codec.errors import CodecError
from pincette.codec.unpacking import msgpack
from pincette.codec.wire import ENCODING, MEDIA_TYPE, explained

__all__ = [
    "ENCODING",
    "MAX_BYTES",
    "MAX_DOCUMENT",
    "MAX_ITEMS",
    "MAX_TEXT",
    "MEDIA_TYPE",
    "CodecError",
    "decode",
    "encode",
    "explained",
    "msgpack",
]
