"""Checks of numbers. Their errors name quantity, value, unit and limit."""

from collections.abc import Sized
from math import isfinite


def require_positive(quantity: str, value: float, unit: str) -> float:
    """Return ``value``; raise ValueError unless it is finite and above 0."""
    if not (isfinite(value) and value > 0.0):
        raise ValueError(_refusal(quantity, value, unit, "above 0"))
    return value


def require_not_negative(quantity: str, value: float, unit: str) -> float:
    """Return ``value``; raise ValueError unless it is finite and at least 0."""
    if not (isfinite(value) and value >= 0.0):
        raise ValueError(_refusal(quantity, value, unit, "at least 0"))
    return value


def require_as_many(quantity: str, values: Sized, other: str, others: Sized) -> None:
    """Raise ValueError unless both have the same number of values."""
    if len(values) != len(others):
        raise ValueError(
            f"{len(values)} {quantity} for {len(others)} {other}, must be equal in number"
        )


def _refusal(quantity: str, value: float, unit: str, limit: str) -> str:
    return f"{quantity} = {f'{value} {unit}'.rstrip()}, must be finite and {limit}"
