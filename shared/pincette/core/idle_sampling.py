"""Sampling while no motion program plays: at a low rate, since only people read the samples."""

SAMPLE_S = 0.1
"""Time between two samples of an idle rig, in s, if it is longer than a control period."""


def idle_periods(period_s: float) -> int:
    """Return the number of control periods from one sample of an idle rig to the next one."""
    return max(1, round(SAMPLE_S / period_s))
