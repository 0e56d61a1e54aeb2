"""How large a message may be, and each of its fields; the unit of a number is read off its name.

The bounds of numbers lie far beyond any gripper: they keep out what would overflow further on, and
leave it to each service to judge what is plausible.
"""

from collections.abc import Mapping

from pincette.records.units import unit_of

MAX_BYTES = 65_536
MAX_TEXT = 400
"""Characters of a text."""
MAX_DOCUMENT = 32_768
"""Characters of a document."""
MAX_ITEMS = 4096
"""Items of a list."""
MAX_FIELDS = 64
"""Fields of a map, known or not."""
LARGEST: Mapping[str, float] = {
    "µm": 1e9,
    "mN": 1e12,
    "V": 1e6,
    "s": 1e12,
    "Hz": 1e9,
    "%": 1e6,
    "µm/s": 1e12,
    "µm/s²": 1e15,
    "mN/s": 1e15,
    "V/s": 1e12,
    "rad/s": 1e12,
    "mN/µm": 1e12,
    "µm/mN": 1e9,
    "µm/V": 1e9,
    "": 1e15,
}
"""Magnitude of a number by its unit; without one for gains and shares."""
LARGEST_INT = 2**53 - 1
"""Magnitude of a whole number: what every language keeps exactly."""
LAST_SEQ = 10**12 - 1
"""Number of the last sample there can be, after decades at any period."""
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
