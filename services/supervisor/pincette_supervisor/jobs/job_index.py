"""The jobs of a rig by name: how each stands, whether it waits, lives, or is over.

Requests that wait for a change ask here again and again; only ``job`` reads the journal.
"""

from time import monotonic

from pincette.api.jobs import Job
from pincette_supervisor.jobs import refusals
from pincette_supervisor.jobs.crash_recovery import NOTHING
from pincette_supervisor.jobs.job import ChangeNotifier, LiveJob
from pincette_supervisor.jobs.job_queue import JobQueue
from pincette_supervisor.jobs.job_view import job_view
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.rigs.rig_context import RigContext

WRITTEN_S = 30.0
"""Longest time that a request waits for records that are being written, in s."""


class JobIndex:
    """How the jobs of one rig stand."""

    def __init__(self, context: RigContext, queue: JobQueue, changes: ChangeNotifier) -> None:
        self._context, self._queue, self._changes = context, queue, changes
        self._lives: tuple[LiveJob, ...] = ()
        """The job that was started last, after those whose record is still being written."""
        self.left = NOTHING
        """The job whose record an earlier supervisor has left open."""

    @property
    def newest(self) -> LiveJob | None:
        """The job that was started last."""
        return next(reversed(self._lives), None)

    @property
    def active(self) -> LiveJob | None:
        """The job that has the rig; a stopped job keeps it while it holds a part."""
        live = self.newest
        return None if live is None or live.done.is_set() else live

    def started(self, live: LiveJob) -> None:
        """Take in a job that starts; those that are recorded need no place any more."""
        self._lives = (*(one for one in self._lives if not one.recorded.is_set()), live)

    def job(self, name: str) -> Job:
        """One job; raises ProblemError if there is none of this name.

        While the journal does not answer, a job that was started is returned from memory.
        """
        live = self._live(name)
        if live is not None and self._context.write_queue.late:
            return self.view(live.row)
        return self.view(refusals.require_job(self._context.store, name))

    def view(self, row: JobRow) -> Job:
        """A job of the journal as it stands."""
        live, place = self._live(row.id), self._queue.position(row.id)
        return job_view(row, live, place, self._context.records, self.left)

    def has_job(self, name: str) -> bool:
        """Whether a job is queued or was started last."""
        return self._queue.entry(name) is not None or self._live(name) is not None

    def is_over(self, name: str) -> bool:
        """Whether a job has ended, and no release of its part is going on."""
        waits = self._queue.entry(name) is not None
        if waits or (live := self._live(name)) is None:
            return not waits
        return live.done.is_set() or (live.terminal and not live.letting_go)

    def is_recorded(self, name: str) -> bool:
        """Whether a job has ended, and its record is written."""
        if not self.is_over(name):  # asked first: from its end on the event tells of its record
            return False
        live = self._live(name)
        written = live is None or live.recorded.is_set()
        return written and not self.left.being_written(name)

    def wait_for_records(self, timeout_s: float) -> None:
        """Wait until the records of ended jobs are written, together for ``timeout_s`` at most."""
        deadline = monotonic() + timeout_s
        for live in self._lives:
            if live.terminal:
                live.recorded.wait(max(0.0, deadline - monotonic()))

    def changed_since(self, name: str, revision: int) -> bool:
        """Whether a job has changed since a revision."""
        entry = self._queue.entry(name)
        if entry is not None:
            return entry.revision != revision
        live = self._live(name)
        return self.is_finished(name) or (live is not None and live.revision != revision)

    def is_finished(self, name: str) -> bool:
        """Return whether a job has ended: it is not queued and not live, and will not change."""
        live = self._live(name)
        return self._queue.entry(name) is None and (live is None or live.done.is_set())

    def note_revision(self, name: str, revision: int) -> None:
        """Let those who wait for a change of a job know of one that the journal has."""
        for known in filter(None, (self._queue.entry(name), self._live(name))):
            known.revision = max(known.revision, revision)
        self._changes.notify_all()

    def _live(self, name: str) -> LiveJob | None:
        """A job that was started and may not be recorded yet; look into the queue first."""
        return next((live for live in self._lives if live.id == name), None)
