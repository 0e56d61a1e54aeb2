"""Amplifier between voltage output and arm, in volts at its input; pure.

limited   v = clip(gain·u, ±saturation)
slewed    |ẇ| <= slew, w follows v
out       τ·ȯ = w - o,   τ = 1/(2π·bandwidth)
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AmplifierParameters:
    """Parameters of the amplifier."""

    gain_ratio: float = 1.0
    saturation_V: float = math.inf
    slew_V_per_s: float = math.inf
    lag_s: float = 0.0


IDEAL = AmplifierParameters()
"""Amplifier whose output equals its input."""


def limited_V(amplifier: AmplifierParameters, input_V: float) -> float:
    """Return the voltage that an amplifier approaches, in V."""
    most_V = amplifier.saturation_V
    return max(-most_V, min(most_V, amplifier.gain_ratio * input_V))


def advance_amplifier(
    amplifier: AmplifierParameters,
    slewed_V: float,
    output_V: float,
    input_V: tuple[float, float],
    dt_s: float,
) -> tuple[float, float]:
    """Return slewed and output voltage after ``dt_s``, with a linear input between two values.

    The result is exact for a constant input. A changing input is followed as a straight line within
    the slew limit.
    """
    start_V, end_V = limited_V(amplifier, input_V[0]), limited_V(amplifier, input_V[1])
    reach_V = amplifier.slew_V_per_s * dt_s
    goal_V = max(slewed_V - reach_V, min(slewed_V + reach_V, end_V))
    lag_s = amplifier.lag_s
    if lag_s <= 0.0:
        return goal_V, goal_V
    moved_V = goal_V - slewed_V
    moving_s = dt_s if start_V != end_V else abs(moved_V) / amplifier.slew_V_per_s
    if moving_s > 0.0:
        behind_V = moved_V / moving_s * lag_s
        output_V = (
            goal_V
            - behind_V
            + (output_V - slewed_V + behind_V) * math.exp(-min(moving_s, dt_s) / lag_s)
        )
    rest_s = dt_s - moving_s
    if rest_s > 0.0:
        output_V = goal_V + (output_V - goal_V) * math.exp(-rest_s / lag_s)
    return goal_V, output_V
