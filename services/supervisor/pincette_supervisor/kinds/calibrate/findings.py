"""What an analysis of a calibration is made of: values, figures, residuals, and how sure it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pincette.api.calibrations import Figure, Identified, Residuals
from pincette.control.planning.paths import Path
from pincette.control.planning.segments import paths_of
from pincette_supervisor.plugin import UNITS, Planned


@dataclass(frozen=True, slots=True)
class Analysis:
    """Values, figures, residuals, and how sure they are."""

    values: tuple[Identified, ...]
    figures: tuple[Figure, ...]
    residuals: Residuals
    statement: str
    drawn: Any
    """What its plot shows."""
    warnings: tuple[str, ...] = ()


def identified(quantity: str, value: float, uncertainty: float) -> Identified:
    """A number with its standard uncertainty."""
    return Identified(
        quantity=quantity, value=float(value), unit=UNITS[quantity], uncertainty=float(uncertainty)
    )


def sure(value: float, uncertainty: float, unit: str, of: str) -> str:
    """How sure a value is, in words."""
    return (
        f"{value:.5g} ± {2.0 * uncertainty:.2g} {unit} at about 95 % (two standard uncertainties, "
        f"{of})"
    )


def residuals(of: str, unit: str, values: Sequence[float] | NDArray[np.float64]) -> Residuals:
    """What a fit has left, in two numbers."""
    found = np.asarray(values, dtype=np.float64)
    return Residuals(
        of=of,
        unit=unit,
        rms=float(np.sqrt(np.mean(found**2))),
        maximum=float(np.max(np.abs(found))),
        count=len(found),
    )


def path_of(planned: Planned, phase: str) -> Path:
    """The path of a phase of the program; raises ValueError where there is none."""
    paths = [path for s in planned.program.segments if s.phase == phase for path in paths_of(s)]
    if not paths:
        raise ValueError(f"the program has no path in its phase {phase!r}")
    return paths[0]


def figure(name: str, value: float, unit: str, meaning: str) -> Figure:
    """Something that the measurement says beside its values."""
    return Figure(name=name, value=float(value), unit=unit, meaning=meaning)
