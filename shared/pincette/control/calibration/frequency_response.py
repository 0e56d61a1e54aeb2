"""Frequency response of the arm from a swept sine."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pincette.control.checks import require_as_many, require_positive

LEAST_POINTS = 10
LEAST_LINES = 3
LEAST_DRIVE = 1e-3
"""Smallest power of the drive in a band, relative to the largest; weaker bands are omitted."""


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """Complex gain of the arm in µm/V by frequency in Hz, and standard uncertainty of its log."""

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
    """Return the frequency response of a recorded sweep that begins and ends at rest.

    From the spectra of the whole record, in bands of equal width, G = Σ X·U*/Σ |U|², and the
    coherence γ² of n lines gives u(log|G|) = √((1 - γ²)/(2·n·γ²)). No window is applied, since it
    would broaden the peak of a lightly damped mode; only the means are subtracted. Bands in which
    the power of the drive is below ``least_drive`` times the strongest are omitted.

    Raises
    ------
    ValueError
        If lengths disagree, a sample is not finite, the frequencies do not ascend to half the rate,
        or fewer than ``LEAST_POINTS`` bands contain three lines and enough drive.
    """
    u, x = np.asarray(voltage_V, dtype=float), np.asarray(x_um, dtype=float)
    require_as_many("voltages", u, "positions", x)
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
            f"{int(np.sum(kept))} bands of {bands} were driven and have enough lines, must "
            f"be at least {LEAST_POINTS}: use a longer sweep or wider bands"
        )
    count, drive, answer, product = count[kept], drive[kept], answer[kept], product[kept]
    # The gain of a band is assigned to the power-weighted centre of the drive within it.
    center_hz = banded(lines_hz * np.abs(U) ** 2)[kept] / drive
    coherence = np.minimum(np.abs(product) ** 2 / (drive * answer), 1.0)
    log_uncertainty = np.sqrt((1.0 - coherence) / (2.0 * count * coherence))
    return FrequencyResponse(center_hz, product / drive, log_uncertainty)
