"""What the job ``calibrate`` calls of a calibration: program, analysis, plot."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pincette.api.checklist import NeedCode
from pincette.config import RigFile
from pincette.control.planning.program import Program
from pincette.core import plugins
from pincette_supervisor.kinds.calibrate import KIND
from pincette_supervisor.kinds.calibrate.findings import Analysis
from pincette_supervisor.plugin import ModelInUse, Present, Run, Wait
from pincette_supervisor.plugin.drawing import Sheet

CalibrationProgram = tuple[Program, dict[str, Any], dict[int, Wait]]
"""A program, the values it was made of, and its waits by the number of their segment."""


def _needed(_rig: RigFile) -> bool:
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFunctions:
    """The functions of one calibration; all are pure."""

    program: Callable[[Any, ModelInUse, Present], CalibrationProgram]
    """Plans the motion of a request, from where the rig stands."""
    analyse: Callable[[Run], Analysis]
    """Works out the quantities; raises ValueError where the samples do not give them."""
    draw: Callable[[Sheet, Any], None]
    """Draws ``drawn`` of the analysis."""
    assumes: tuple[str, ...] = ()
    """Quantities of the model in use that it takes for granted."""
    finds: tuple[str, ...] = ()
    """Quantities of the model that it proposes; what assumes one of them comes after it."""
    needs: tuple[NeedCode, ...] = ("part_removed",)
    """What a person does at the bench."""
    needed: Callable[[RigFile], bool] = _needed
    """Whether a rig cannot do without it."""
    of_bring_up: bool = True
    """Whether the checklist has it; what belongs to one program is not of a rig's bring-up."""
    meets_part: bool = False
    """A part is expected, and a law leads the arm to it."""
    goes_on: Callable[[Any, Run], tuple[Any, str]] | None = None
    """After a stall has tripped it, the request that keeps what is measured, and words that say
    where it goes on. None: it begins again from its start, since the voltage went to the safe one
    and no branch of the hysteresis was left as it was."""
    moves_less: Callable[[Any, Run], tuple[Any, str] | None] | None = None
    """After it has led the arm beyond a limit of position, the request of a smaller motion, and
    words that say which; None where there is none."""


def functions_of(calibration: str) -> CalibrationFunctions:
    """Import the functions of a calibration; raises PluginError."""
    named = KIND.variants[calibration].functions
    return plugins.resolve(named, CalibrationFunctions, f"calibration {calibration!r}")
