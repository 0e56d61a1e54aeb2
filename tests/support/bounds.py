"""Limits of a message's numbers by field name, as docs/explanations/wire.md states them."""

from collections.abc import Mapping

from pincette.control.quantities import LARGEST, LARGEST_INT, LAST_SEQ
from pincette.core.units import unit_of

RANGES: Mapping[str, tuple[int, int]] = {
    "epoch": (0, LARGEST_INT),
    "seq": (-1, LAST_SEQ),
    "applied_seq": (-1, LAST_SEQ),
    "last_seq": (-1, LAST_SEQ),
    "at_seq": (-1, LAST_SEQ),
}
"""Ranges of whole numbers; seq -1 precedes the first sample."""


def largest(name: str) -> float:
    """Return the largest magnitude of a number with this field name."""
    return LARGEST[unit_of(name)]


def whole_range(name: str) -> tuple[int, int]:
    """Return the smallest and largest whole number with this field name."""
    return RANGES.get(name, (-LARGEST_INT, LARGEST_INT))
