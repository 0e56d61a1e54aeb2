"""Jobs and their actions, so that what was accepted survives a restart.

Never called from the event loop: a slow disk must not hold up a stop.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import Connection, Select, and_, func, insert, select, update

from pincette.api.states import STATES, JobState
from pincette_supervisor.journal import event_rows
from pincette_supervisor.journal.base import Base, StoreError
from pincette_supervisor.journal.rows import (
    ActionRow,
    Creation,
    EventRow,
    JobRow,
    action_row,
    job_row,
    utc_now,
)
from pincette_supervisor.journal.tables import ACTIONS, CREATIONS, JOBS, NOTES

__all__ = [
    "ActionRow",
    "Creation",
    "EventRow",
    "JobRow",
    "KeyTakenError",
    "Store",
    "StoreError",
    "utc_now",
]

LEFT_OVER = "the supervisor ended while the job ran"
PROBE = "probe"
CHANGING = ("state", "cause", "plan", "result", "started_at", "ended_at", "epoch")


class KeyTakenError(Exception):
    """The ``Idempotency-Key`` has created a job already."""

    def __init__(self, job: str, fingerprint: str) -> None:
        super().__init__(f"the key has created job {job}")
        self.job, self.fingerprint = job, fingerprint


class Store(Base):
    """The journal in one file; safe to use from several threads."""

    def interrupt_left_over(self, at: str) -> list[str]:
        """Mark jobs that an earlier run of the supervisor left unfinished; returns their names.

        What is queued has not begun, and stays queued. Nobody listens yet: their events are kept,
        and told to whoever asks for the past.
        """
        kept = ["queued", *(name for name, state in STATES.items() if state.terminal)]
        left = select(JOBS.c.id, JOBS.c.rig).where(JOBS.c.state.not_in(kept))
        body = {"state": "interrupted", "cause": LEFT_OVER, "event": "interrupt"}
        with self.writing() as base:
            found = base.execute(left.order_by(JOBS.c.number)).all()
            for name, rig in found:
                values = {"state": "interrupted", "cause": LEFT_OVER, "ended_at": at}
                _revise(base, name, values)
                event_rows.add(base, at, rig, name, "state", body)
        return [name for name, _ in found]

    def add(self, job: JobRow, key: str | None = None, fingerprint: str = "") -> JobRow:
        """Keep a new job, and the key it was created with; returns it with its number.

        Raises
        ------
        KeyTakenError
            Where the key has created a job already; nothing is kept then.
        """
        with self.writing() as base:
            if key is not None and (taken := _creation(base, key)) is not None:
                raise KeyTakenError(taken.job, taken.fingerprint)
            number = base.scalar(select(func.coalesce(func.max(JOBS.c.number), 0) + 1))
            base.execute(
                insert(JOBS).values(
                    id=job.id,
                    number=number,
                    kind=job.kind,
                    rig=job.rig,
                    state=job.state,
                    cause=job.cause,
                    request=job.request,
                    plan=job.plan,
                    revision=1,
                    created_at=job.created_at,
                    requested_by=job.requested_by,
                )
            )
            if key is not None:
                _keep_key(base, key, fingerprint, job)
            return _select(base, select(JOBS).where(JOBS.c.id == job.id))[0]

    def created(self, key: str) -> Creation | None:
        """What an ``Idempotency-Key`` has created; None where it is not known."""
        with self.reading() as base:
            return _creation(base, key)

    def change(self, name: str, **values: object) -> int:
        """Change some of state, cause, plan, result, started_at, ended_at and epoch.

        Returns the job's revision, which every change raises by one; raises LookupError where
        there is no job of this name.
        """
        odd = values.keys() - set(CHANGING)
        if odd:
            raise ValueError(f"a job's {', '.join(sorted(odd))} cannot be changed")
        if values.get("epoch") is not None:
            values["epoch"] = str(values["epoch"])
        with self.writing() as base:
            return _revise(base, name, values)

    def add_action(self, name: str, action: ActionRow) -> int:
        """Keep an action that was asked for; returns its number within the job."""
        with self.writing() as base:
            _revise(base, name, {})
            count = select(func.count()).select_from(ACTIONS).where(ACTIONS.c.job == name)
            number = int(base.scalar(count) or 0)
            base.execute(
                insert(ACTIONS).values(
                    job=name,
                    number=number,
                    type=action.type,
                    requested_at=action.requested_at,
                    requested_by=action.by,
                    applied_at=action.applied_at,
                    seq=action.seq,
                )
            )
        return number

    def action_took_effect(
        self, name: str, number: int, seq: int | None, at: str | None = None
    ) -> None:
        """Note when an action took effect, ``at`` or else the present, and at which sample."""
        which = and_(ACTIONS.c.job == name, ACTIONS.c.number == number)
        with self.writing() as base:
            base.execute(update(ACTIONS).where(which).values(seq=seq, applied_at=at or utc_now()))
            _revise(base, name, {})

    def get(self, name: str) -> JobRow | None:
        """One job; None where there is none of this name."""
        with self.reading() as base:
            found = _select(base, select(JOBS).where(JOBS.c.id == name))
        return found[0] if found else None

    def newest(
        self,
        limit: int,
        *,
        kind: str | None = None,
        state: JobState | None = None,
        rig: str | None = None,
        label: tuple[str, str] | None = None,
        before_number: int | None = None,
    ) -> list[JobRow]:
        """Jobs, the newest first; only those that are as named, where something is named.

        ``label`` is a label's name and value; ``before_number`` begins below a job's number.
        """
        query = select(JOBS).order_by(JOBS.c.number.desc()).limit(limit)
        for column, value in ((JOBS.c.kind, kind), (JOBS.c.state, state), (JOBS.c.rig, rig)):
            if value is not None:
                query = query.where(column == value)
        if label is not None:
            name, text = label
            query = query.where(JOBS.c.request[("labels", name)].as_string() == text)
        if before_number is not None:
            query = query.where(JOBS.c.number < before_number)
        with self.reading() as base:
            return _select(base, query)

    def queued(self, rig: str) -> list[JobRow]:
        """Jobs of a rig that wait for their turn, the next first."""
        waits = and_(JOBS.c.state == "queued", JOBS.c.rig == rig)
        with self.reading() as base:
            return _select(base, select(JOBS).where(waits).order_by(JOBS.c.number))

    def counted(self) -> dict[tuple[str, str, str], int]:
        """How many jobs there are, by rig, kind and state; none where there is none."""
        names = JOBS.c.rig, JOBS.c.kind, JOBS.c.state
        with self.reading() as base:
            found = base.execute(select(*names, func.count()).group_by(*names)).all()
        return {(rig, kind, state): count for rig, kind, state, count in found}

    def add_event(self, at: str, rig: str, job: str | None, kind: str, body: dict[str, Any]) -> int:
        """Keep an event; returns its number, which rises and is never given twice."""
        with self.writing() as base:
            return event_rows.add(base, at, rig, job, kind, body)

    def events_after(
        self, number: int, *, rig: str | None = None, job: str | None = None, limit: int = 200
    ) -> list[EventRow]:
        """Events beyond a number, the oldest first; of a rig or a job, where one is named."""
        with self.reading() as base:
            return event_rows.after(base, number, rig, job, limit)

    def newest_event(self) -> int:
        """Number of the newest event; 0 where there is none."""
        return self.event_span()[1]

    def event_span(self) -> tuple[int, int]:
        """Numbers of the oldest event that is kept and of the newest; 0 where there is none."""
        with self.reading() as base:
            return event_rows.span(base)

    def note(self, name: str, value: str) -> None:
        """Keep a fact of the rig beyond a restart."""
        with self.writing() as base:
            changed = base.execute(update(NOTES).where(NOTES.c.name == name).values(value=value))
            if changed.rowcount == 0:
                base.execute(insert(NOTES).values(name=name, value=value))

    def probe(self) -> bool:
        """Whether anything can be written; see ``trouble``."""
        try:
            self.note(PROBE, utc_now())
        except StoreError:
            return False
        return True

    def noted(self, name: str) -> str | None:
        """A fact kept under this name."""
        with self.reading() as base:
            return base.scalar(select(NOTES.c.value).where(NOTES.c.name == name))


def _creation(base: Connection, key: str) -> Creation | None:
    query = select(CREATIONS.c.job, CREATIONS.c.fingerprint).where(CREATIONS.c.key == key)
    row = base.execute(query).one_or_none()
    return None if row is None else Creation(row.job, row.fingerprint)


def _keep_key(base: Connection, key: str, fingerprint: str, job: JobRow) -> None:
    base.execute(
        insert(CREATIONS).values(
            key=key, fingerprint=fingerprint, job=job.id, created_at=job.created_at
        )
    )


def _revise(base: Connection, name: str, values: Mapping[str, object]) -> int:
    changed = base.execute(
        update(JOBS).where(JOBS.c.id == name).values(**values, revision=JOBS.c.revision + 1)
    )
    if changed.rowcount == 0:
        raise LookupError(f"there is no job {name!r}")
    return int(base.scalar(select(JOBS.c.revision).where(JOBS.c.id == name)) or 0)


def _select(base: Connection, query: Select[Any]) -> list[JobRow]:
    rows = base.execute(query).mappings().all()
    actions = _actions(base, [row["id"] for row in rows])
    return [job_row({**row}, tuple(actions[row["id"]])) for row in rows]


def _actions(base: Connection, names: Sequence[str]) -> dict[str, list[ActionRow]]:
    found: dict[str, list[ActionRow]] = {name: [] for name in names}
    if not names:
        return found
    query = select(ACTIONS).where(ACTIONS.c.job.in_(names)).order_by(ACTIONS.c.number)
    for row in base.execute(query).mappings():
        found[row["job"]].append(action_row({**row}))
    return found
