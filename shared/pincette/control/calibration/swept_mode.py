"""Mode of the arm from a recorded sweep: ω_n, ζ and gain, and the Bode plot of Fig. 5.

The input is the measured drive, so that a lag of the output has no effect. A delay of the position
(averaging of the sensor) and a phase lag that is equal at every frequency (hysteresis, as a
rate-independent loss) are fitted to the phase alone:

    arg(X/U) = arg(model) - φ_h - ω·τ

Figure numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from pincette.control.calibration.frequency_response import FrequencyResponse, swept_response
from pincette.control.calibration.resonance import SecondOrder, fit_second_order
from pincette.control.checks import require_positive

LINES_PER_BAND = 20
"""Number of spectral lines in a band: enough to compute the coherence, and few enough that the band
is narrow compared with the resonance."""
FEWEST_BANDS = 100
LEAST_DRIVE = 1e-5
"""Smallest power of the drive relative to the strongest. The drive is measured, and an output with
a lag weakens it at the mode; the coherence shows the quality of such bands."""
LARGEST_UNCERTAINTY = 0.1
"""Largest uncertainty of log|G| in a band. Less certain bands, for example where the sweep fades
out, are omitted from the plot."""
BANDWIDTH_SHARE = 0.25
"""Largest width of a band relative to the resonance's half width ζ·f_n. In wider bands the mean
lowers the peak by more than 0.6 %."""

SWING_S, REST_S = 0.05, 0.5
"""Duration, in s, of the intervals whose swings are compared, and of the rests at both ends that
define the zero of the swings."""
LARGE = 0.2
"""Smallest swing that is compared, relative to the largest. Smaller swings are near the noise."""
LEAST_EVENNESS = 0.9
"""Smallest ratio of the upward to the downward swing, or its inverse. Free arms have 0.95 and more,
since a sweep shifts the middle of a hysteresis loop."""

Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SweptMode:
    """Model (54) identified from a sweep, with its uncertainties and the curves of a Bode plot."""

    model: SecondOrder
    small_signal_gain_um_per_V: float
    """Gain at low frequency and the sweep's amplitude, in µm/V. It is below the d_p of a larger
    drive because of hysteresis."""
    delay_s: float
    """Delay τ from the drive to the reading, in s."""
    hysteresis_phase_rad: float
    """Phase lag φ_h that is the same at every frequency, in rad."""
    coherence: float
    """Median over the bands of the fraction of the motion that the drive explains."""
    residual_percent: float
    """R.m.s. deviation of the magnitude from the model, in %, weighted as in the fit."""
    frequency_hz: Column
    magnitude_db: Column
    """Magnitude in dB relative to 1 µm/V."""
    phase_deg: Column
    """Phase in degrees, unwrapped from the lowest frequency on."""
    model_magnitude_db: Column
    model_phase_deg: Column
    """Phase of the model in degrees, with delay and hysteresis."""


def swept_mode(
    drive_V: Sequence[float] | Column,
    x_um: Sequence[float] | Column,
    rate_hz: float,
    *,
    from_hz: float,
    to_hz: float,
) -> SweptMode:
    """Identify the mode from a sweep that begins and ends at rest.

    Raises
    ------
    ValueError
        For the reasons given in ``swept_response`` and ``fit_second_order``, and if the record is
        so short that its bands are too wide for the resonance.
    """
    require_positive("sampling rate", rate_hz, "Hz")
    duration_s = len(x_um) / rate_hz
    bands = max(FEWEST_BANDS, int((to_hz - from_hz) * duration_s / LINES_PER_BAND))
    response = swept_response(
        np.asarray(drive_V, dtype=float).tolist(),
        np.asarray(x_um, dtype=float).tolist(),
        rate_hz,
        from_hz=from_hz,
        to_hz=to_hz,
        bands=bands,
        least_drive=LEAST_DRIVE,
    )
    response = _sure(response)
    model = fit_second_order(
        response.frequency_hz,
        response.gain_um_per_V,
        to_hz=to_hz,
        log_gain_uncertainty=response.log_gain_uncertainty,
        higher_modes=True,
    )
    half_width_hz = model.damping_ratio * model.natural_frequency_rad_per_s / (2.0 * pi)
    band_hz = (to_hz - from_hz) / bands
    if band_hz > BANDWIDTH_SHARE * half_width_hz:
        raise ValueError(
            f"bands of {band_hz:.2f} Hz for a resonance of {half_width_hz:.2f} Hz half width, must "
            f"be at most {BANDWIDTH_SHARE * half_width_hz:.2f} Hz: record a longer sweep"
        )
    return _drawn(response, model)


def require_even_swing(x_um: Column, rate_hz: float) -> None:
    """Refuse a sweep with a larger swing to one side, which shows an obstacle at the other side.

    Raises
    ------
    ValueError
        If the ratio of upward and downward swing is below ``LEAST_EVENNESS`` at the resonance or in
        the median of all large swings.
    """
    span, rest = max(1, round(SWING_S * rate_hz)), max(1, round(REST_S * rate_hz))
    if len(x_um) < 2 * rest + span:
        return  # also too short for a mode, which the fit reports
    ends = (float(np.mean(x_um[:rest])), float(np.mean(x_um[-rest:])))
    about = x_um - np.linspace(*ends, len(x_um))
    spans = about[: len(about) // span * span].reshape(-1, span)
    up, down = spans.max(axis=1), -spans.min(axis=1)
    largest = int(np.argmax(up + down))
    large = up + down >= LARGE * (up[largest] + down[largest])
    at_resonance = float(up[largest] - down[largest]) / float(up[largest] + down[largest])
    typical = float(np.median((up - down)[large] / (up + down)[large]))
    uneven = max(at_resonance, typical, key=abs)
    if abs(uneven) > (1.0 - LEAST_EVENNESS) / (1.0 + LEAST_EVENNESS):
        side, way = ("below", "up") if uneven > 0.0 else ("above", "down")
        raise ValueError(
            f"the arm swings {100.0 * abs(uneven):.1f} % farther {way} from the middle of "
            f"its swings of {up[largest] + down[largest]:.2f} µm at {ends[0]:.2f} µm: a part "
            f"seems to be in the way {side} it: remove it and calibrate again"
        )


def _sure(response: FrequencyResponse) -> FrequencyResponse:
    """Return the significant bands, or all bands if too few for the fit are significant."""
    kept = response.log_gain_uncertainty <= LARGEST_UNCERTAINTY
    if int(np.sum(kept)) < FEWEST_BANDS // 2:
        return response
    return FrequencyResponse(
        response.frequency_hz[kept],
        response.gain_um_per_V[kept],
        response.log_gain_uncertainty[kept],
    )


def _drawn(response: FrequencyResponse, model: SecondOrder) -> SweptMode:
    f = response.frequency_hz
    fitted = model.gain_at(f)
    # A lower bound of the uncertainty prevents a single clean band from dominating the fit.
    weights = 1.0 / np.maximum(
        response.log_gain_uncertainty, float(np.median(response.log_gain_uncertainty))
    )
    lag = np.unwrap(np.angle(fitted / response.gain_um_per_V))
    columns = np.column_stack([np.ones(len(f)), 2.0 * pi * f])
    solution = np.linalg.lstsq(columns * weights[:, np.newaxis], lag * weights, rcond=None)[0]
    phase, delay_s = float(solution[0]), float(solution[1])
    delayed = fitted * np.exp(-1j * (columns @ solution))
    residuals = np.asarray(model.residuals)
    # u² = (1 - γ²)/(2·n·γ²), where n is about LINES_PER_BAND.
    squares = 2.0 * LINES_PER_BAND * response.log_gain_uncertainty**2
    return SweptMode(
        model=model,
        small_signal_gain_um_per_V=model.gain_um_per_V,
        delay_s=delay_s,
        hysteresis_phase_rad=phase,
        coherence=float(np.median(1.0 / (1.0 + squares))),
        residual_percent=100.0 * float(np.sqrt(np.average(residuals**2, weights=weights**2))),
        frequency_hz=f,
        magnitude_db=20.0 * np.log10(np.abs(response.gain_um_per_V)),
        phase_deg=np.degrees(np.unwrap(np.angle(response.gain_um_per_V))),
        model_magnitude_db=20.0 * np.log10(np.abs(fitted)),
        model_phase_deg=np.degrees(np.unwrap(np.angle(delayed))),
    )
