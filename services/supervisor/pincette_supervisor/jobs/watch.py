"""Whether a job's deadline has passed, by the time in which somebody has looked.

A deadline says that a rig does not do what it was asked for. Where the supervisor stood still, it
has only not seen it yet: that time is not the job's.
"""

from collections.abc import Callable
from time import monotonic

from pincette_supervisor.jobs import policies
from pincette_supervisor.jobs.job import LiveJob
from pincette_supervisor.jobs.tracker import Tracker
from pincette_supervisor.planning.planned import Planned

LOOK_S = 0.25
"""Between two looks; what goes beyond it was a standstill of the one who looks."""


class Watch:
    """The deadlines of one job."""

    def __init__(
        self,
        job: LiveJob,
        planned: Planned,
        tracker: Tracker,
        clock: Callable[[], float],
        look_clock: Callable[[], float] = monotonic,
    ) -> None:
        """``clock`` is that of the job's states; ``look_clock`` measures the looks."""
        self._job, self._planned, self._tracker = job, planned, tracker
        self._clock, self._look_clock = clock, look_clock
        self._looked_s = look_clock()
        self._missed_s = self._missed_before_s = 0.0
        self._moves = -1

    def look(self) -> None:
        """Look once."""
        now_s = self._look_clock()
        missed_s = max(0.0, now_s - self._looked_s - LOOK_S)
        self._looked_s = now_s
        if self._job.moves != self._moves:
            self._moves, self._missed_before_s = self._job.moves, self._missed_s
        self._missed_s += missed_s

    def overdue(self) -> bool:
        """Whether the deadline of the job's state has passed."""
        job, rig = self._job, self._planned.model.rig
        on_stop = policies.on_stop(job.request)
        limit_s = policies.deadline_s(job.state, self._planned, rig, on_stop)
        spent_s = self._clock() - job.entered_at
        running = job.state == "running"
        if rig.lockstep:
            # A machine may take as long as it likes for what is played.
            spent_s = self._tracker.played_s if running else spent_s
        elif running:
            spent_s += job.played_s - self._missed_s
        else:
            spent_s -= self._missed_s - self._missed_before_s
        return limit_s is not None and spent_s > limit_s
