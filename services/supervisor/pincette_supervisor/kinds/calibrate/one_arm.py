"""A calibration of one arm of two: its program moves that arm's voltage, the other rests.

Each calibration is written for a rig of one arm. Here that rig is taken out of one of two, its
program is put on the arm's voltage, and its columns and quantities are found under their names.
"""

import dataclasses

from msgspec.structs import replace

from pincette.config import Calibration, RigFile
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Drive, Segment, Stay
from pincette_supervisor.kinds.calibrate.calibration import Analysis
from pincette_supervisor.plugin import FaultyRequestError, ModelInUse, Run
from pincette_supervisor.plugin.figures import table_of_arm

SECOND = "second."


def model_of_arm(model: ModelInUse, arm: int) -> ModelInUse:
    """The rig as one of this arm alone; raises FaultyRequestError where it has no such arm."""
    arms = model.rig.arms
    if arm > len(arms):
        raise FaultyRequestError("/arm", f"arm = {arm}, and this rig has one driven arm")
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
    """Return the program on the arm's voltage, the other at rest; of a rig of one arm as it is.

    Raises
    ------
    ValueError
        Where it is more than a motion of the voltage.
    """
    if rig.second is None:
        return program
    if program.capture_hz or not all(isinstance(segment, Drive) for segment in program.segments):
        raise ValueError(
            "a calibration that sweeps, acquires or meets a part is for rigs of one driven arm; of "
            "two, calibrate noise and free_response of each"
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
    """Return what a job has gathered of this arm, as if it were the only one."""
    planned = run.planned
    model = model_of_arm(planned.model, arm)
    segments = planned.program.segments if arm == 1 else map(_on_first, planned.program.segments)
    program = replace(planned.program, segments=tuple(segments))
    table = table_of_arm(run.table, arm)
    of_arm = dataclasses.replace(planned, model=model, program=program, expecting=None)
    return dataclasses.replace(run, rig=model.rig, planned=of_arm, table=table)


def named_of_arm(analysis: Analysis, arm: int) -> Analysis:
    """Return quantities under the names that the rig file of two arms has for them."""
    if arm == 1:
        return analysis
    values = tuple(
        value.model_copy(update={"quantity": SECOND + value.quantity}) for value in analysis.values
    )
    return dataclasses.replace(analysis, values=values)
