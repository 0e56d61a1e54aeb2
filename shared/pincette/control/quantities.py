"""Types of record fields; each type has a unit and limits.

The limits are far beyond those of any gripper. They exclude values that would overflow later; each
service checks which values are plausible.
"""

from typing import Annotated, NewType, TypeVar

from msgspec import Meta

from pincette.control.vocabulary import LARGEST

T = TypeVar("T")

LARGEST_INT = 2**53 - 1
"""Largest magnitude of a whole number: every language represents it exactly."""
LAST_SEQ = 10**12 - 1
"""Largest number of a sample, reached after decades at any period."""
MAX_TEXT = 400
"""Largest number of characters in a text."""
MAX_DOCUMENT = 32_768
"""Largest number of characters in a document."""
MAX_ITEMS = 4096
"""Largest number of items in a list."""


def _within(unit: str) -> Meta:
    return Meta(ge=-LARGEST[unit], le=LARGEST[unit], extra={"unit": unit})


Micrometre = Annotated[float, _within("µm")]
Millinewton = Annotated[float, _within("mN")]
MillinewtonPerMicrometre = Annotated[float, _within("mN/µm")]
MicrometrePerMillinewton = Annotated[float, _within("µm/mN")]
Volt = Annotated[float, _within("V")]
Second = Annotated[float, _within("s")]
Hertz = Annotated[float, _within("Hz")]
Number = Annotated[float, _within("")]
"""A number without a fixed unit: a gain, a fraction, or a value of a path in the unit of its
quantity."""

Whole = Annotated[int, Meta(ge=-LARGEST_INT, le=LARGEST_INT)]
Epoch = Annotated[int, Meta(ge=0, le=LARGEST_INT)]
Seq = Annotated[int, Meta(ge=-1, le=LAST_SEQ)]
"""Number of a sample; -1 before the first one."""

Document = NewType("Document", str)
"""A text of many lines, such as JSON; other texts are short."""
Text = Annotated[str, Meta(max_length=MAX_TEXT)]
LongText = Annotated[Document, Meta(max_length=MAX_DOCUMENT)]
Items = Annotated[tuple[T, ...], Meta(max_length=MAX_ITEMS)]
Arms = Annotated[tuple[T, ...], Meta(min_length=1, max_length=2)]
"""One item for each driven arm."""
