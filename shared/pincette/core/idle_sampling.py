"""How often the sensor samples while nothing plays: seldom, since only people look at it then."""

SAMPLE_S = 0.1
"""Time between two samples of an idle rig, in s, where that is more than a control period."""


def idle_periods(period_s: float) -> int:
    """Return the number of control periods from one sample of an idle rig to the next one."""
    return max(1, round(SAMPLE_S / period_s))
