"""Recovery at start from an earlier supervisor's end."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

from pincette.api.results import JobResult
from pincette.api.states import STATES
from pincette.bus.protocol import Bus, BusError, RefusalError
from pincette.core.faults import ActionCode, Mode
from pincette.core.messages import Action, Applied, Recorded
from pincette.core.topics import ACTION
from pincette.records import folder, parquet
from pincette.records.columns import Columns
from pincette_supervisor.jobs import policies
from pincette_supervisor.jobs.job_queue import CAPACITY
from pincette_supervisor.jobs.job_recorder import finish_record
from pincette_supervisor.jobs.lease import ended_text
from pincette_supervisor.journal.job_filter import JobFilter
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.results.documents import completeness
from pincette_supervisor.results.result import course
from pincette_supervisor.rigs.rig_context import RigContext

ASK_S = 1.0
RECENT = CAPACITY + 4
"""Jobs among which that which moved last is sought: those that wait are newer."""


@dataclass(frozen=True, slots=True)
class Left:
    """The job whose record an earlier supervisor has left open, and which is closed meanwhile."""

    job: str = ""
    stored: Future[None] | None = None

    def being_written(self, job: str) -> bool:
        """Whether what the closed record gives is still to be stored."""
        return self.stored is not None and job == self.job and not self.stored.done()


NOTHING = Left()


def recover_from_crash(
    context: RigContext, jobs: Sequence[str], notify: Callable[[], None]
) -> Left:
    """Stop a program that still plays, and close the record of the newest interrupted job.

    ``notify`` is called once it is closed.
    """
    # The program is asked once. A held part stays held until a person holds or releases it by a
    # job; a free arm comes to rest, and what a calibration presses is let go. No job is continued.
    row = context.store.get(jobs[-1]) if jobs else None
    how = policies.interruption("" if row is None else row.kind)
    stopped = _stop(context, how) or _stopped_by_itself(context)
    if stopped:
        name = None if row is None else row.id
        with context.events.transaction("rig", name, found="a program played", did=stopped):
            if row is not None:
                context.store.change(row.id, cause=f"{row.cause}; {stopped}")
    if row is None or row.epoch is None:
        row = _unwritten(context)
    if row is not None and row.epoch is not None:
        # Making its tables takes its time, and an emergency stop must be taken meanwhile.
        applied = context.observer.newest(Applied)
        last_seq = None if applied is None or applied.epoch != row.epoch else applied.seq
        whose = context.bus, row.id, row.epoch
        closed = context.closer.submit(_closed, *whose, last_seq)
        stored = context.archivist.submit(_store_end, context, row, closed)
        stored.add_done_callback(lambda _: notify())
        return Left(row.id, stored)
    return NOTHING


def _unwritten(context: RigContext) -> JobRow | None:
    """The job that moved last, where its supervisor ended before its record was closed."""
    found = context.store.newest(RECENT, JobFilter(rig=context.rig.rig.name))
    last = next((row for row in found if row.epoch is not None), None)
    if last is None or not STATES[last.state].terminal:
        return None
    record = last.plan.get("record")
    return last if record is None or record.get("open") else None


def _stop(context: RigContext, how: ActionCode) -> str:
    actuator = context.health.status("actuator")
    if actuator is None or actuator.mode != Mode.ARMED:
        return ""
    try:
        context.bus.call(ACTION, Action(how), ASK_S)
    except RefusalError as error:
        return f"the program was not stopped: {error}"
    except BusError as error:
        return f"the program that still plays could not be stopped: {error}"
    part = "a held part is let go" if how == ActionCode.RETRACT else "a held part stays held"
    return f"the program that still played was stopped after the restart; {part}"


def _stopped_by_itself(context: RigContext) -> str:
    """The controller's text of a lease that has ended while no supervisor ran."""
    controller = context.health.status("controller")
    words = "" if controller is None else ended_text(controller)
    if not words:
        return ""
    context.alarms.raise_alarm("lease", words, severity="alarm", clears="acknowledge")
    return words


def _closed(bus: Bus, job: str, epoch: int, last_seq: int | None) -> Recorded | str:
    """Have the recorder close its open record."""
    recorded = finish_record(bus, job, epoch, last_seq)
    if isinstance(recorded, str):  # it may still make the tables of an unfinished record
        recorded = finish_record(bus, job, epoch, last_seq)
    return recorded


def _store_end(context: RigContext, row: JobRow, closed: Future[Recorded | str]) -> None:
    """Store whether a record is complete that was closed after the restart, and how far it came."""
    recorded = closed.result()
    found = _result(context.records / row.id / folder.SAMPLES, context.rig.rig.period_s)
    values: dict[str, object] = {}
    if found is not None and row.result is None:
        values = {"result": found.model_dump(mode="json")}
    context.store.change(row.id, plan={**row.plan, "record": completeness(recorded)}, **values)


def _result(samples: Path, period_s: float) -> JobResult | None:
    """How far a job came, by its closed record; the kind's own figures need its plan's model."""
    try:
        table: Columns = parquet.opened(samples).read().to_pydict()
    except (OSError, ValueError):  # no record, or one that a full disk has cut off
        return None
    return JobResult(**course(table, period_s=period_s, dropped=0))
