"""Jobs, actions, events and notes in the journal; never called from the event loop."""

import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from sqlalchemy import (
    Connection,
    Select,
    String,
    and_,
    cast,
    delete,
    func,
    insert,
    select,
    update,
)

from pincette.api.endings import Ending
from pincette.api.events import Event
from pincette.api.jobs import DESCRIPTION
from pincette.api.states import STATES, JobState
from pincette_supervisor.journal.database import (
    Database,
    StoreError,
    columns,
    first,
    matching,
    rows,
)
from pincette_supervisor.journal.job_filter import EVERY_JOB, JobFilter
from pincette_supervisor.journal.tables import (
    ACTIONS,
    CREATIONS,
    EVENTS,
    JOBS,
    NOTES,
    ActionRow,
    Creation,
    JobRow,
    TableRow,
    utc_now,
)

__all__ = ["ActionRow", "JobRow", "KeyTakenError", "Store", "StoreError", "utc_now"]

INTERRUPTED = "the supervisor ended while the job ran"
PROBE, IDENTIFIER = "probe", "supervisor"
PAGE = 250
"""Largest number of jobs read in one query; a longer list is read in several queries."""
EVENTS_KEPT = 200_000
"""Smallest number of events that are kept, enough for some weeks of work."""
EVENTS_SWEEP = 500
"""Number of added events after which the oldest are deleted; at most twice as many are deleted at
once.
"""
CHANGING = ("state", "cause", "ending", "plan", "result", "started_at", "ended_at", "epoch")
EDITABLE = (*DESCRIPTION, "labels", "pinned", "priority", "place")
"""Fields of a job that a person may change, and their columns."""

TABLE_COLUMNS = (
    *(JOBS.c[name] for name in ("number", "id", "rig", "kind", "state")),
    *(JOBS.c[name] for name in ("created_at", "started_at", "ended_at", "requested_by")),
    JOBS.c.ending["code"].as_string(),
    *(JOBS.c[name] for name in DESCRIPTION),
    *(
        func.coalesce(cast(column, String), "null")
        for column in (JOBS.c.labels, JOBS.c.plan["values"], JOBS.c.result)
    ),
)
"""Columns of the journal that the table of jobs reads: a number, and a ``TableRow``."""


class KeyTakenError(Exception):
    """Error raised if the ``Idempotency-Key`` has already created a job."""

    def __init__(self, job: str, fingerprint: str) -> None:
        super().__init__(f"the key has created job {job}")
        self.job, self.fingerprint = job, fingerprint


class Store(Database):
    """The journal in one file; safe to use from several threads."""

    def unfinished(self) -> list[str]:
        """Return the jobs that have neither ended nor wait to begin, oldest first."""
        with self.reading() as connection:
            return [name for name, _ in _live(connection)]

    def interrupt_unfinished(self, at: str) -> list[str]:
        """Mark jobs that an earlier supervisor left unfinished, except queued ones; return their
        names."""
        with self.writing() as connection:
            return _interrupt(connection, _live(connection), at)

    def interrupt(self, names: Sequence[str], at: str) -> None:
        """Mark the jobs among ``names`` that an earlier supervisor left unfinished."""
        with self.writing() as connection:
            _interrupt(connection, [job for job in _live(connection) if job[0] in names], at)

    def add(self, job: JobRow, key: str | None = None, fingerprint: str = "") -> JobRow:
        """Store a new job and its key; return it with its number. Raises KeyTakenError."""
        with self.writing() as connection:
            if key is not None and (taken := _creation(connection, key)) is not None:
                raise KeyTakenError(taken.job, taken.fingerprint)
            number = connection.scalar(select(func.coalesce(func.max(JOBS.c.number), 0) + 1))
            values = {**columns(job, "actions"), "number": number, "revision": 1}
            connection.execute(insert(JOBS).values(values))
            if key is not None:
                created = Creation(key, fingerprint, job.id, job.created_at)
                connection.execute(insert(CREATIONS).values(columns(created)))
            return _select(connection, select(JOBS).where(JOBS.c.id == job.id))[0]

    def created(self, key: str) -> Creation | None:
        """Return the job that an ``Idempotency-Key`` has created; None if the key is unknown."""
        with self.reading() as connection:
            return _creation(connection, key)

    def change(self, name: str, **values: object) -> int:
        """Change columns of a job; return the revision. Raises LookupError without the job."""
        odd = values.keys() - {*CHANGING, *EDITABLE}
        if odd:
            raise ValueError(f"a job's {', '.join(sorted(odd))} cannot be changed")
        with self.writing() as connection:
            return _revise(connection, name, values)

    def add_action(self, name: str, action: ActionRow) -> int:
        """Store a requested action; return its number within the job."""
        with self.writing() as connection:
            _revise(connection, name, {})
            count = select(func.count()).select_from(ACTIONS).where(ACTIONS.c.job == name)
            number = int(connection.scalar(count) or 0)
            connection.execute(insert(ACTIONS).values(job=name, number=number, **columns(action)))
        return number

    def action_took_effect(self, name: str, number: int, seq: int | None, at: str) -> None:
        """Store when an action took effect, and at which sample."""
        which = and_(ACTIONS.c.job == name, ACTIONS.c.number == number)
        with self.writing() as connection:
            connection.execute(update(ACTIONS).where(which).values(seq=seq, applied_at=at))
            _revise(connection, name, {})

    def get(self, name: str) -> JobRow | None:
        """Return one job; None if no job has this name."""
        with self.reading() as connection:
            found = _select(connection, select(JOBS).where(JOBS.c.id == name))
        return found[0] if found else None

    def newest(self, limit: int, found: JobFilter = EVERY_JOB) -> list[JobRow]:
        """Return jobs, newest first; only those that match a filter."""
        with self.reading() as connection:
            return _select(connection, found.newest(limit, connection.dialect.name))

    def newest_revisions(self, limit: int, found: JobFilter = EVERY_JOB) -> list[tuple[str, int]]:
        """Return names and revisions of the jobs that ``newest`` would return."""
        with self.reading() as connection:
            query = found.newest(limit, connection.dialect.name)
            wanted = query.with_only_columns(JOBS.c.id, JOBS.c.revision)
            return [(name, revision) for name, revision in connection.execute(wanted)]

    def several(self, names: Sequence[str]) -> list[JobRow]:
        """Return the jobs with these names, in any order."""
        with self.reading() as connection:
            return _select(connection, select(JOBS).where(JOBS.c.id.in_(names)))

    def table_pages(self, found: JobFilter, limit: int | None = None) -> Iterator[list[TableRow]]:
        """Read the values of jobs for a table, newest first, at most ``PAGE`` jobs at once."""
        left = limit
        while left is None or left > 0:
            size = PAGE if left is None else min(PAGE, left)
            with self.reading() as connection:
                query = found.newest(size, connection.dialect.name)
                page = connection.execute(query.with_only_columns(*TABLE_COLUMNS)).all()
            yield [_table_row(*row) for row in page]
            if len(page) < size:
                return
            found = replace(found, before_number=page[-1].number)
            left = None if left is None else left - len(page)

    def queued(self, rig: str, state: JobState = "queued") -> list[JobRow]:
        """Return the queued jobs of a rig, or those in another state, the next one first."""
        query = select(JOBS).where(JOBS.c.state == state)
        with self.reading() as connection:
            found = _select(connection, query.order_by(JOBS.c.place, JOBS.c.number))
        # If the query contained the rig, SQLite would read all jobs of the rig.
        return [job for job in found if job.rig == rig]

    def counted(self) -> dict[tuple[str, str, str], int]:
        """Return the number of jobs by rig, kind and state.

        Combinations without jobs are left out.
        """
        names = JOBS.c.rig, JOBS.c.kind, JOBS.c.state
        with self.reading() as connection:
            found = connection.execute(select(*names, func.count()).group_by(*names)).all()
        return {(rig, kind, state): count for rig, kind, state, count in found}

    def use_since(self, rig: str, since: str | None) -> tuple[int, int, float]:
        """Return strokes, contacts and armed seconds of the jobs of a rig that started since a
        time; None: of all jobs."""
        names = ("strokes", "contacts", "duration_s")
        use = [func.sum(JOBS.c.result["use", name].as_float()) for name in names]
        query = select(*use).where(JOBS.c.rig == rig)
        if since is not None:
            query = query.where(JOBS.c.started_at >= since)
        with self.reading() as connection:
            strokes, contacts, armed_s = (
                float(one or 0.0) for one in connection.execute(query).one()
            )
        return round(strokes), round(contacts), armed_s

    def add_event(self, at: str, rig: str, job: str | None, kind: str, body: dict[str, Any]) -> int:
        """Store an event; return its number, which rises and is never reused."""
        with self.writing() as connection:
            return _add_event(connection, at, rig, job, kind, body)

    def events_after(
        self, number: int, *, rig: str | None = None, job: str | None = None, limit: int = 200
    ) -> list[Event]:
        """Return events after a number, oldest first; only those of a rig or a job, if it is
        given."""
        query = matching(select(EVENTS).where(EVENTS.c.number > number), rig=rig, job=job)
        return self.rows(Event, query.order_by(EVENTS.c.number).limit(limit))

    def event_span(self) -> tuple[int, int]:
        """Return the numbers of the oldest stored event and of the newest; 0 if there is none."""
        with self.reading() as connection:
            return _event_span(connection)

    def set_note(self, name: str, value: str) -> None:
        """Store a fact of the rig, which is kept across restarts."""
        with self.writing() as connection:
            changed = connection.execute(
                update(NOTES).where(NOTES.c.name == name).values(value=value)
            )
            if changed.rowcount == 0:
                connection.execute(insert(NOTES).values(name=name, value=value))

    def identifier(self) -> str:
        """Return the identifier of the supervisor with this journal, created at its first start."""
        found = self.get_note(IDENTIFIER)
        if found is None:
            found = secrets.token_hex(8)
            with suppress(StoreError):  # on a full disk the identifier is used until the next start
                self.set_note(IDENTIFIER, found)
        return found

    def probe(self) -> bool:
        """Return whether the journal can be written; if not, ``trouble`` states the reason."""
        try:
            self.set_note(PROBE, utc_now())
        except StoreError:
            return False
        return True

    def get_note(self, name: str) -> str | None:
        """Return the fact stored under this name."""
        return self.get_notes([name]).get(name)

    def get_notes(self, names: Sequence[str]) -> dict[str, str]:
        """Return the facts stored under these names, by name."""
        query = select(NOTES.c.name, NOTES.c.value).where(NOTES.c.name.in_(names))
        with self.reading() as connection:
            return {row.name: row.value for row in connection.execute(query)}


def _table_row(_number: int, *columns: Any) -> TableRow:
    *fixed, labels, values, result = columns
    return TableRow(tuple(fixed), labels, values, result)


def _creation(connection: Connection, key: str) -> Creation | None:
    query = select(CREATIONS).where(CREATIONS.c.key == key)
    return first(connection, Creation, query)


def _live(connection: Connection) -> list[tuple[str, str]]:
    """Return names and rigs of jobs that have neither ended nor wait to begin, oldest first."""
    live = [name for name, state in STATES.items() if "interrupt" in state.events]
    query = select(JOBS.c.id, JOBS.c.rig).where(JOBS.c.state.in_(live)).order_by(JOBS.c.number)
    return [(name, rig) for name, rig in connection.execute(query)]


def _interrupt(connection: Connection, jobs: Sequence[tuple[str, str]], at: str) -> list[str]:
    """Mark jobs as interrupted; return their names."""
    ended = Ending(code="supervisor_ended")
    body = {"state": "interrupted", "cause": INTERRUPTED, "event": "interrupt"}
    body["ending"] = ended.code
    values = {
        "state": "interrupted",
        "cause": INTERRUPTED,
        "ending": ended.model_dump(mode="json"),
        "ended_at": at,
    }
    for name, rig in jobs:
        _revise(connection, name, values)
        _add_event(connection, at, rig, name, "state", body)
    return [name for name, _ in jobs]


def _revise(connection: Connection, name: str, values: Mapping[str, object]) -> int:
    changed = connection.execute(
        update(JOBS).where(JOBS.c.id == name).values(**values, revision=JOBS.c.revision + 1)
    )
    if changed.rowcount == 0:
        raise LookupError(f"there is no job {name!r}")
    return int(connection.scalar(select(JOBS.c.revision).where(JOBS.c.id == name)) or 0)


def _select(connection: Connection, query: Select[Any]) -> list[JobRow]:
    found = rows(connection, JobRow, query)
    names = [job.id for job in found]
    actions: dict[str, list[ActionRow]] = {name: [] for name in names}
    wanted = select(ACTIONS).where(ACTIONS.c.job.in_(names)).order_by(ACTIONS.c.number)
    for row in connection.execute(wanted).mappings():
        values = {name: value for name, value in row.items() if name not in ("job", "number")}
        actions[row["job"]].append(ActionRow(**values))
    return [
        # An epoch has 48 bit, and its column holds text.
        replace(
            job,
            actions=tuple(actions[job.id]),
            epoch=None if job.epoch is None else int(job.epoch),
        )
        for job in found
    ]


def _add_event(
    connection: Connection, at: str, rig: str, job: str | None, kind: str, body: dict[str, Any]
) -> int:
    row = connection.execute(insert(EVENTS).values(at=at, rig=rig, job=job, kind=kind, body=body))
    (number,) = row.inserted_primary_key or (0,)
    if number % EVENTS_SWEEP == 0:
        end = min(number - EVENTS_KEPT, _event_span(connection)[0] + 2 * EVENTS_SWEEP)
        connection.execute(delete(EVENTS).where(EVENTS.c.number < end))
    return int(number)


def _event_span(connection: Connection) -> tuple[int, int]:
    # SQLite finds both ends by the index only if each has a separate query.
    ends = select(
        select(func.min(EVENTS.c.number)).scalar_subquery(),
        select(func.max(EVENTS.c.number)).scalar_subquery(),
    )
    oldest, newest = connection.execute(ends).one()
    return oldest or 0, newest or 0
