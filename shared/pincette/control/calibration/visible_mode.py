"""Test whether samples at a period resolve the mode.

It is a separate module, so that a request does not load NumPy.
"""

from math import pi

NYQUIST_SHARE = 0.95
"""Fraction of half the sampling rate below which the mode must lie."""


def shows_mode(natural_frequency_rad_per_s: float, period_s: float) -> bool:
    """Return whether the mode lies below half the sampling rate, with some margin."""
    return natural_frequency_rad_per_s * period_s <= NYQUIST_SHARE * pi


def require_visible(natural_frequency_rad_per_s: float, period_s: float) -> None:
    """Refuse a period at which samples do not resolve the mode; raises ValueError with a remedy."""
    mode_hz = natural_frequency_rad_per_s / (2.0 * pi)
    if not shows_mode(natural_frequency_rad_per_s, period_s):
        longest_s = NYQUIST_SHARE * 0.5 / mode_hz
        aliased_hz = abs(mode_hz - round(mode_hz * period_s) / period_s)
        raise ValueError(
            f"period_s = {period_s:g} s: samples do not show the mode of the arm at "
            f"{mode_hz:.0f} Hz, which aliases to {aliased_hz:.0f} Hz, so that delay and lag "
            f"cannot be found from it; limit {longest_s:.4g} s. Choose a shorter period, or "
            "keep model.output_delay_s and model.output_lag_s of the rig file"
        )
