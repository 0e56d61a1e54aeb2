"""Text that people and other programs wrote: UTF-8, with or without its mark."""

import codecs

MARKS = (
    (codecs.BOM_UTF32_LE, "UTF-32"),
    (codecs.BOM_UTF32_BE, "UTF-32"),
    (codecs.BOM_UTF16_LE, "UTF-16"),
    (codecs.BOM_UTF16_BE, "UTF-16"),
)
"""Byte order marks of other encodings; those of UTF-32 begin as those of UTF-16 do."""
LOOKED_AT = 200
"""Bytes at the begin of a text in which zeros show an encoding without a mark."""


class EncodingError(ValueError):
    """A text is not UTF-8; names the encoding, the place and the remedy."""


def decoded(content: bytes) -> str:
    """Decode UTF-8, leaving out its byte order mark; raises EncodingError."""
    for mark, name in MARKS:
        if content.startswith(mark):
            raise EncodingError(f"it is {name}: {_remedy(name)}")
    head = content[:LOOKED_AT]
    if 3 * head.count(0) > len(head):  # every other character of a Latin text in UTF-16
        raise EncodingError(f"it is UTF-16 or UTF-32 without a mark: {_remedy('UTF-16LE')}")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise EncodingError(
            f"it is not UTF-8: byte 0x{content[error.start]:02X} in line {line}; save it as UTF-8. "
            f"Where it came from an older Windows program: {_remedy('WINDOWS-1252')}"
        ) from error


def _remedy(encoding: str) -> str:
    return f"save it as UTF-8, or `iconv -f {encoding} -t UTF-8 FILE > NEW`"
