"""Interface of calibrations to the job ``calibrate``, and the data of their analysis.

Each calibration is written for a rig of one arm. For a rig of two arms, the rig is reduced to the
arm that is calibrated. The program moves that arm's voltage while the other arm rests, and columns
and quantities are renamed accordingly.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from pincette.api.calibrations import Figure, Identified, Residuals
from pincette.api.checklist import NeedCode
from pincette.config import Calibration, RigFile
from pincette.control.planning.paths import Path
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Segment, Stay, paths_of
from pincette.core import plugins
from pincette.core.messages import Message
from pincette.records.columns import Columns
from pincette.records.tables import joined
from pincette_supervisor.kinds.calibrate import KIND
from pincette_supervisor.plugin import (
    ASSUMED,
    UNITS,
    FaultyRequestError,
    ModelInUse,
    Planned,
    Present,
    Run,
    Wait,
    value_of,
)
from pincette_supervisor.plugin.drawing import Sheet
from pincette_supervisor.plugin.figures import MOST_MISSING, Series, series, table_of_arm

CalibrationProgram = tuple[Program, dict[str, Any], dict[int, Wait]]
"""A program, the values behind it, and the confirmations it waits for, by segment number."""
MOST_UNLIKE = 0.1
"""Largest relative change of a value that is attributed to the free arm itself; a part in the way
causes a larger change.
"""


@dataclass(frozen=True, slots=True)
class Analysis:
    """Identified values, further figures, residuals, and their reliability."""

    values: tuple[Identified, ...]
    figures: tuple[Figure, ...]
    residuals: Residuals
    statement: str
    drawn: Any
    """Data for the plot."""
    warnings: tuple[str, ...] = ()


def _needed(_rig: RigFile) -> bool:
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFunctions:
    """The functions of one calibration; all are pure."""

    program: Callable[[Any, ModelInUse, Present], CalibrationProgram]
    """Function that plans the motion of a request, from the present state of the rig."""
    analyse: Callable[[Run], Analysis]
    """Function that computes the quantities; raises ValueError where the samples do not determine
    them."""
    draw: Callable[[Sheet, Any], None]
    """Function that draws ``Analysis.drawn``."""
    assumes: tuple[str, ...] = ()
    """Quantities of the model in use that the calibration assumes to be known."""
    finds: tuple[str, ...] = ()
    """Quantities of the model that the calibration proposes. A calibration that assumes one of
    these quantities comes later in the order.
    """
    needs: tuple[NeedCode, ...] = ("part_removed",)
    """Tasks that a person must do at the rig before the calibration."""
    needed: Callable[[RigFile], bool] = _needed
    """Function that returns True if a rig needs the calibration."""
    of_bring_up: bool = True
    """True if the calibration belongs to the bring-up checklist; a calibration for a single program
    does not."""
    meets_part: bool = False
    """True if a part is expected, and a law moves the arm against it."""
    goes_on: Callable[[Any, Run], tuple[Any, str]] | None = None
    """Function that returns the request that continues after a stall has tripped the
    calibration, with the values measured so far, and a message that says where it continues.
    None if the calibration must start again, since the output was set to the safe voltage and
    the state of the hysteresis was lost."""
    moves_less: Callable[[Any, Run], tuple[Any, str] | None] | None = None
    """Function that returns the request of a smaller motion after the arm has exceeded a position
    limit, and a message that describes it; None: there is no smaller motion."""


def functions_of(calibration: str) -> CalibrationFunctions:
    """Import the functions of a calibration; raises PluginError."""
    named = KIND.variants[calibration].functions
    return plugins.resolve(named, CalibrationFunctions, f"calibration {calibration!r}")


def identified(quantity: str, value: float, uncertainty: float) -> Identified:
    """Return an identified value with its standard uncertainty."""
    return Identified(
        quantity=quantity, value=float(value), unit=UNITS[quantity], uncertainty=float(uncertainty)
    )


def sure(value: float, uncertainty: float, unit: str, of: str) -> str:
    """Return the reliability of a value, in words."""
    return (
        f"{value:.5g} ± {2.0 * uncertainty:.2g} {unit} at about 95 % (two standard uncertainties, "
        f"{of})"
    )


def residuals(of: str, unit: str, values: Sequence[float] | NDArray[np.float64]) -> Residuals:
    """Return the residuals of a fit, as two numbers."""
    found = np.asarray(values, dtype=np.float64)
    return Residuals(
        of=of,
        unit=unit,
        rms=float(np.sqrt(np.mean(found**2))),
        maximum=float(np.max(np.abs(found))),
        count=len(found),
    )


def path_of(planned: Planned, phase: str) -> Path:
    """Return the path of a phase of the program; raises ValueError if there is none."""
    paths = [path for s in planned.program.segments if s.phase == phase for path in paths_of(s)]
    if not paths:
        raise ValueError(f"the program has no path in its phase {phase!r}")
    return paths[0]


def figure(name: str, value: float, unit: str, meaning: str) -> Figure:
    """Return a figure that the measurement yields in addition to its values."""
    return Figure(name=name, value=float(value), unit=unit, meaning=meaning)


def require_like_in_use(model: ModelInUse, quantity: str, value: float) -> None:
    """Reject a change larger than an arm shows without cause; assumed values are not compared.

    Raises
    ------
    ValueError
        If ``value`` differs by more than ``MOST_UNLIKE`` from one that was calibrated.
    """
    source = model.calibration.sources.get(quantity, ASSUMED)
    if source == ASSUMED:
        return
    in_use = value_of(model.rig, quantity)
    off = value / in_use - 1.0
    if abs(off) > MOST_UNLIKE:
        raise ValueError(
            f"{quantity} = {value:.4g} {UNITS[quantity]}, which is {100.0 * off:+.0f} % from "
            f"the {in_use:.4g} {UNITS[quantity]} in use, found by calibration {source}; "
            f"limit {100.0 * MOST_UNLIKE:g} %. Something may touch the arm, such as a part "
            "in the way: remove it and calibrate again. If arm, amplifier or sensor was "
            "changed, go back to the rig file alone first (`pincette model use 0`)"
        )


@dataclass(frozen=True, slots=True)
class Samples:
    """N samples, one for each period from the first to the last; NaN for missing ones.

    Voltage and position are aligned in time: the voltage is the one that caused the position.
    """

    period_s: float
    phase: tuple[str, ...]
    x_um: Series
    voltage_V: Series
    force_mN: Series
    """Estimated force, unfiltered, in mN."""

    def of(self, phase: str) -> slice:
        """Return the samples of a phase.

        Raises
        ------
        ValueError
            If there are no samples of the phase.
        """
        places = [place for place, name in enumerate(self.phase) if name == phase]
        if not places:
            raise ValueError(f"phase {phase!r} was not reached")
        return slice(places[0], places[-1] + 1)

    def filled(self, values: Series, place: slice, what: str) -> Series:
        """Return values with a few missing ones interpolated.

        Raises
        ------
        ValueError
            If the share of missing values exceeds ``MOST_MISSING``.
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
    """Put the columns of one epoch on their uniform time grid."""
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
    """Samples from a buffered acquisition of the sensor, at the rate ``rate_hz``."""

    rate_hz: float
    x_um: Series
    drive_V: Series


def acquisition(messages: Iterable[Message]) -> Acquisition | None:
    """Join the bursts of one epoch; None without a burst. Raises the errors of ``joined``."""
    found = joined(messages)
    if found is None:
        return None
    return Acquisition(found.rate_hz, np.asarray(found.x_um), np.asarray(found.drive_V))


SECOND = "second."


def model_of_arm(model: ModelInUse, arm: int) -> ModelInUse:
    """Return the rig reduced to one of its arms.

    Raises FaultyRequestError if that arm does not exist.
    """
    arms = model.rig.arms
    if arm > len(arms):
        raise FaultyRequestError("/arm", f"arm = {arm}, but this rig has one driven arm")
    if arm == 1:
        return dataclasses.replace(model, rig=arms[0])
    sources = {
        name.removeprefix(SECOND): source
        for name, source in model.calibration.sources.items()
        if name.startswith((SECOND, "part."))
    }
    calibration = Calibration(sources=sources)
    return dataclasses.replace(model, rig=arms[1], calibration=calibration)


def program_for_both(program: Program, rig: RigFile, arm: int) -> Program:
    """Return the program for one arm of two, the other at rest; unchanged for a rig of one arm.

    Raises
    ------
    ValueError
        If the program has other segments than motions of the voltage.
    """
    if rig.second is None:
        return program
    if program.capture_hz or not all(isinstance(segment, Drive) for segment in program.segments):
        raise ValueError(
            "calibrations that sweep, acquire or touch a part need a rig with one driven "
            "arm; with two arms, calibrate noise and free_response of each"
        )
    if arm == 1:
        return program
    return replace(program, segments=tuple(map(_on_second, program.segments)))


def _on_second(segment: Segment) -> Segment:
    if not isinstance(segment, Drive):
        return segment
    return replace(segment, courses=(Stay(), *segment.courses))


def _on_first(segment: Segment) -> Segment:
    if not isinstance(segment, Drive):
        return segment
    return replace(segment, courses=segment.courses[1:])


def run_of_arm(run: Run, arm: int) -> Run:
    """Return the recorded data of one arm, under the names of a rig with a single arm."""
    planned = run.planned
    model = model_of_arm(planned.model, arm)
    segments = planned.program.segments if arm == 1 else map(_on_first, planned.program.segments)
    program = replace(planned.program, segments=tuple(segments))
    table = table_of_arm(run.table, arm)
    of_arm = dataclasses.replace(planned, model=model, program=program, expecting=None)
    return dataclasses.replace(run, rig=model.rig, planned=of_arm, table=table)


def named_of_arm(analysis: Analysis, arm: int) -> Analysis:
    """Return the quantities under their names in the rig file of two arms."""
    if arm == 1:
        return analysis
    values = tuple(
        value.model_copy(update={"quantity": SECOND + value.quantity}) for value in analysis.values
    )
    return dataclasses.replace(analysis, values=values)
