"""A whole grip in one process on the bus in memory, and its speed relative to real time."""

from time import process_time

from pincette.config import RigFile
from pincette.core.messages import Position
from pincette.engine.composed import ComposedLoop
from pincette_supervisor.kinds.grip import GripJobRequest
from pincette_supervisor.planning.job_plans import plan_job

ROUNDS = 5


def composed_over_realtime(rig: RigFile) -> float:
    """Return simulated time over CPU time of the best of several grips, including the plant."""
    program = plan_job(GripJobRequest(kind="grip"), rig).program
    best = 0.0
    for _ in range(ROUNDS):
        loop = ComposedLoop(rig)
        begin_s = process_time()
        messages = loop.play(program)
        spent_s = process_time() - begin_s
        ticks = sum(isinstance(message, Position) for message in messages)
        best = max(best, ticks * rig.rig.period_s / spent_s)
    return best
