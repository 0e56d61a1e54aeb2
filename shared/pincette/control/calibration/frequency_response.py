"""Swept sine: the frequency response of the arm, from a sweep or from steps of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_positive

LEAST_POINTS = 10
LEAST_LINES = 3
LEAST_DRIVE = 1e-3
"""Share of the strongest drive below which a band tells nothing."""


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """Bands of frequency in Hz, complex gain in µm/V, and the standard uncertainty of its log."""

    frequency_hz: NDArray[np.float64]
    gain_um_per_V: NDArray[np.complex128]
    log_gain_uncertainty: NDArray[np.float64]


def swept_response(
    voltage_V: Sequence[float],
    x_um: Sequence[float],
    rate_hz: float,
    *,
    from_hz: float,
    to_hz: float,
    bands: int = 200,
    least_drive: float = LEAST_DRIVE,
) -> FrequencyResponse:
    """Frequency response of a recorded sweep that begins and ends at rest.

    Over the spectra of the whole record, in bands of even width, G = Σ X·U*/Σ |U|², and from the
    coherence γ² of n lines u(log|G|) = √((1 - γ²)/(2·n·γ²)). The record is taken whole: a window
    would smear the peak of a lightly damped mode. The means are taken off, no more. Bands driven
    with less than ``least_drive`` of the strongest, in power, are left out.

    Raises
    ------
    ValueError
        Where lengths disagree, a sample is not finite, the frequencies do not ascend to half the
        rate, or fewer than ``LEAST_POINTS`` bands have three lines and were driven.
    """
    u, x = np.asarray(voltage_V, dtype=float), np.asarray(x_um, dtype=float)
    if len(u) != len(x):
        raise ValueError(f"{len(u)} voltages for {len(x)} positions, must be as many")
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise ValueError("a sample of the sweep is not finite, all must be")
    require_positive("sampling rate", rate_hz, "Hz")
    if not 0.0 < from_hz < to_hz <= 0.5 * rate_hz:
        raise ValueError(
            f"sweep from {from_hz} Hz to {to_hz} Hz, must ascend from above 0 Hz "
            f"to {0.5 * rate_hz} Hz at most"
        )
    lines_hz = np.asarray(np.fft.rfftfreq(len(u), 1.0 / rate_hz), dtype=np.float64)
    U, X = np.fft.rfft(u - np.mean(u)), np.fft.rfft(x - np.mean(x))
    edges = np.linspace(from_hz, to_hz, bands + 1)
    place = np.searchsorted(edges, lines_hz, side="right") - 1
    inside = (place >= 0) & (place < bands)

    def banded(values: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.bincount(place[inside], weights=values[inside], minlength=bands)
        return np.asarray(sums, dtype=np.float64)

    count, cross = banded(np.ones(len(U))), X * np.conj(U)
    drive, answer = banded(np.abs(U) ** 2), banded(np.abs(X) ** 2)
    product = banded(cross.real) + 1j * banded(cross.imag)
    kept = (
        (count >= LEAST_LINES)
        & (drive > least_drive * float(np.max(drive)))
        & (np.abs(product) > 0.0)
    )
    if int(np.sum(kept)) < LEAST_POINTS:
        raise ValueError(
            f"{int(np.sum(kept))} bands of {bands} were driven and have lines enough, "
            f"must be at least {LEAST_POINTS}: a longer sweep or wider bands"
        )
    count, drive, answer, product = count[kept], drive[kept], answer[kept], product[kept]
    # The drive's centre within the band is where its gain belongs.
    center_hz = banded(lines_hz * np.abs(U) ** 2)[kept] / drive
    coherence = np.minimum(np.abs(product) ** 2 / (drive * answer), 1.0)
    log_uncertainty = np.sqrt((1.0 - coherence) / (2.0 * count * coherence))
    return FrequencyResponse(center_hz, product / drive, log_uncertainty)


def locked_in(
    voltage_V: Sequence[float], x_um: Sequence[float], rate_hz: float, frequency_hz: float
) -> complex:
    """Complex gain in µm/V of one step of a stepped sweep: sine and cosine by least squares.

    Offsets and drifts are fitted beside them.

    Raises
    ------
    ValueError
        Where lengths disagree, a sample is not finite, there are less than two periods or four
        samples a period, or the voltage has no part at the frequency.
    """
    u, x = np.asarray(voltage_V, dtype=float), np.asarray(x_um, dtype=float)
    if len(u) != len(x):
        raise ValueError(f"{len(u)} voltages for {len(x)} positions, must be as many")
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise ValueError("a sample of the step is not finite, all must be")
    per_period = require_positive("sampling rate", rate_hz, "Hz") / require_positive(
        "frequency", frequency_hz, "Hz"
    )
    if per_period < 4.0 or len(u) < 2.0 * per_period:
        raise ValueError(
            f"{len(u)} samples at {per_period:.2f} a period, must be two periods and "
            "four samples in each at least"
        )
    phase = 2.0 * pi * np.arange(len(u)) / per_period
    drift = np.linspace(-1.0, 1.0, len(u))
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones(len(u)), drift])
    a, b = (np.linalg.lstsq(columns, values, rcond=None)[0] for values in (u, x))
    drive = complex(a[0], -a[1])
    if not abs(drive) > 1e-9 * (1.0 + float(np.max(np.abs(u)))):
        raise ValueError(f"voltage of {abs(drive)} V at {frequency_hz} Hz, must be driven there")
    return complex(b[0], -b[1]) / drive
