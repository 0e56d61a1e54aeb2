"""Samples of a calibration on their even grid, and the acquisition of the sensor's buffer."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pincette.core.messages import Message
from pincette.records.columns import Columns
from pincette.records.tables import joined
from pincette_supervisor.plugin.figures import MOST_MISSING, Series, series


@dataclass(frozen=True, slots=True)
class Samples:
    """N samples, one each period from the first to the last; NaN where one never came.

    Voltage and position are of matched ages: the voltage is the one that led to the position.
    """

    period_s: float
    phase: tuple[str, ...]
    x_um: Series
    voltage_V: Series
    force_mN: Series
    """As estimated, unfiltered."""

    def of(self, phase: str) -> slice:
        """The samples of a phase, from its first to its last.

        Raises
        ------
        ValueError
            Where it never came.
        """
        places = [place for place, name in enumerate(self.phase) if name == phase]
        if not places:
            raise ValueError(f"phase {phase!r} never came")
        return slice(places[0], places[-1] + 1)

    def filled(self, values: Series, place: slice, what: str) -> Series:
        """Values with the few that are missing interpolated.

        Raises
        ------
        ValueError
            Where more than ``MOST_MISSING`` of them are.
        """
        found = values[place]
        missing = np.isnan(found)
        count = int(missing.sum())
        if count > MOST_MISSING * len(found):
            raise ValueError(
                f"{count} of {len(found)} samples of the {what} are missing, "
                f"limit {100.0 * MOST_MISSING:g} %"
            )
        if count:
            grid = np.arange(len(found))
            found = np.interp(grid, grid[~missing], found[~missing])
        return found


def samples(table: Columns, period_s: float) -> Samples:
    """Put the columns of one epoch on their even grid."""
    numbers = np.array(table["seq"], dtype=int)
    count = int(numbers[-1]) + 1 if len(numbers) else 0

    def spread(values: Series) -> Series:
        grid = np.full(count, np.nan)
        grid[numbers] = values
        return grid

    measured = series(table, "position_valid") == 1.0
    voltage_V = spread(series(table, "voltage_V"))
    names = dict(zip(table["seq"], table["phase"], strict=True))
    phases: list[str] = []
    for seq in range(count):
        phases.append(names.get(seq) or (phases[-1] if phases else ""))
    return Samples(
        period_s=period_s,
        phase=tuple(phases),
        x_um=spread(np.where(measured, series(table, "x_um"), np.nan)),
        voltage_V=np.concatenate([voltage_V[:1], voltage_V[:-1]]),
        force_mN=spread(series(table, "force_mN")),
    )


@dataclass(frozen=True, slots=True)
class Acquisition:
    """What the sensor acquired from its buffer, one sample each 1/``rate_hz``."""

    rate_hz: float
    x_um: Series
    drive_V: Series


def acquisition(messages: Iterable[Message]) -> Acquisition | None:
    """Join the bursts of one epoch; None without one. Raises as ``joined`` does."""
    found = joined(messages)
    if found is None:
        return None
    return Acquisition(found.rate_hz, np.asarray(found.x_um), np.asarray(found.drive_V))
