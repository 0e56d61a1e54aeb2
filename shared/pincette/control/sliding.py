"""The boundary layer of the sliding function."""


def saturation(s: float, delta: float) -> float:
    """Saturation that takes the place of sgn(s) in (25).

        sat(s) = sgn(s) where |s| > δ,  s/δ where |s| ≤ δ                                (32)

    ``s`` and ``delta`` are in the unit of the sliding function; δ > 0. The result is in [-1, 1].
    """
    if s > delta:
        return 1.0
    if s < -delta:
        return -1.0
    return s / delta
