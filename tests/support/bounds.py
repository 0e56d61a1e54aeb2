"""Limits of a message's numbers by their names, as docs/explanations/wire.md states them."""

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
"""Whole numbers that count; seq -1 comes before the first sample."""


def largest(name: str) -> float:
    """Largest magnitude of a number that has this name."""
    return LARGEST[unit_of(name)]


def whole_range(name: str) -> tuple[int, int]:
    """Smallest and largest whole number that may have this name."""
    return RANGES.get(name, (-LARGEST_INT, LARGEST_INT))
