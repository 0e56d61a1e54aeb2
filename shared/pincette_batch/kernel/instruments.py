"""Readings and voltages as the instruments' text carries them."""

import math

from pincette_batch.kernel.constants import Bench

SPLIT = 134217729.0
"""2²⁷ + 1, which cuts a number into halves whose products are exact (Dekker)."""
CLEAR = 1e-6
"""Distance from a tie, in counts, that no rounding of a product bridges."""


def reading_um(k: Bench, x_um: float, drift_um: float, noise: float) -> float:
    """Position as the simulated laser shows it, and its driver takes it.

    The view of ``sensor_view.reading_um``, and the digits of ``keyence_commands.value``.
    """
    noise_um = k.sensor_noise_um * noise
    shown_um = round((x_um + drift_um + noise_um) / k.sensor_step_um) * k.sensor_step_um
    counts = round(shown_um / k.um_per_unit * k.counts_per_unit)
    return counts / k.counts_per_unit * k.um_per_unit


def arm_um(k: Bench, reading_um: float) -> float:
    """Position of the arm: the reading from the sensor's place."""
    return k.direction * (reading_um - k.offset_um)


def put_out_V(k: Bench, voltage_V: float) -> float:
    """Voltage in whole mV, as DCON carries it, rounded to the step of the output."""
    sent_V = rounded(voltage_V, 1000.0) / 1000.0
    return round(sent_V / k.output_step_V) * k.output_step_V


def rounded(value: float, scale: float) -> float:
    """The whole number nearest to value·scale, of an even scale below 2²⁶; a tie goes to the even.

    As a text with so many digits is rounded: by the product itself, not by the float next to it.
    """
    product = value * scale
    below = math.floor(product)
    above_tie = (product - below) - 0.5
    if abs(above_tie) <= CLEAR:
        cut = SPLIT * value
        high = cut - (cut - value)
        above_tie += (high * scale - product) + (value - high) * scale
    if above_tie == 0.0:
        return below + below % 2.0
    return below + 1.0 if above_tie > 0.0 else below + 0.0
