"""Filter for the jobs of the journal."""

import json
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Integer, Select, String, cast, literal_column, or_, select

from pincette.api.states import JobState
from pincette_supervisor.journal.database import matching
from pincette_supervisor.journal.tables import JOB_SEARCH, JOBS

COLUMNS = ("kind", "state", "rig", "sample", "batch", "operator", "pinned")
"""Conditions on single columns, each of which has an index."""
LISTED = ("kind", "state", "rig", "pinned")
"""Conditions that ``ix_jobs_listed`` has too; most jobs of a laboratory may have the same
values."""
FIRST, LAST = "", "9999-12-31T24"
"""Texts before and after every time in the journal."""
UNINDEXED_NUMBER = literal_column("+jobs.number", Integer)
"""Job number in a form that keeps SQLite from using its index, so that it uses the one with the
times."""
TRIGRAM = 3
"""Length of the shortest text that the full-text index of a file finds."""
OUTCOME_ON_SERVER = literal_column("(jobs.result ->> 'outcome')", String)
WORDS_ON_SERVER = literal_column(
    "(jobs.id || ' ' || jobs.cause || ' ' || coalesce(jobs.requested_by, '') || ' ' || jobs.sample "
    "|| ' ' || jobs.batch || ' ' || jobs.operator || ' ' || jobs.notes || ' ' || "
    "(jobs.labels::text))",
    String,
)
"""Expressions as in the indexes of ``migrations``; PostgreSQL uses an index only for equal
expressions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFilter:
    """Conditions on jobs; None sets no condition."""

    kind: str | None = None
    state: JobState | None = None
    rig: str | None = None
    label: tuple[str, str] | None = None
    """Name and value of a label."""
    outcome: str | None = None
    sample: str | None = None
    batch: str | None = None
    operator: str | None = None
    pinned: bool | None = None
    text: str | None = None
    """Part of the job's id, sample, batch, operator, notes, labels, cause or requester. ASCII
    letters match in upper and lower case."""
    created_from: str | None = None
    """Earliest creation time, in UTC, in the format of the journal."""
    created_to: str | None = None
    """Creation time before which the jobs were created."""
    before_number: int | None = None

    def newest(self, limit: int, dialect: str) -> Select[Any]:
        """Return the query of the newest jobs that match, for an SQL dialect."""
        columns = {name: getattr(self, name) for name in COLUMNS}
        found = self._found_in_file() if dialect == "sqlite" else []
        several = sum(value is not None for value in columns.values()) > 1
        if dialect == "sqlite" and several and not found:
            return self._newest_by_several(limit, columns)
        query = matching(JOBS.select(), **columns).where(*self._conditions())
        number: ColumnElement[int] = JOBS.c.number
        before = number
        if dialect != "sqlite":
            query = query.where(*self._found_on_server())
        elif found:
            query = query.join(JOB_SEARCH, JOB_SEARCH.c.rowid == JOBS.c.number).where(*found)
            number = before = JOB_SEARCH.c.rowid
        elif self.created_from is not None or self.created_to is not None:
            before = UNINDEXED_NUMBER
        if self.before_number is not None:
            query = query.where(before < self.before_number)
        return query.order_by(number.desc()).limit(limit)

    def _newest_by_several(self, limit: int, columns: dict[str, Any]) -> Select[Any]:
        """Return the query for conditions on several columns in a file.

        By the index of one of them, SQLite would read every job with its value. This query reads
        only ``ix_jobs_listed``, or the index of a sample, batch or operator, and then the jobs
        found.
        """
        listed = {name: columns.pop(name) for name in LISTED}
        numbers = matching(select(JOBS.c.number), **columns).where(
            *(
                literal_column(f"+jobs.{name}", JOBS.c[name].type) == value
                for name, value in listed.items()
                if value is not None
            ),
            *self._conditions(),
        )
        if self.before_number is not None:
            numbers = numbers.where(JOBS.c.number < self.before_number)
        numbers = numbers.order_by(JOBS.c.number.desc()).limit(limit).correlate(None)
        return JOBS.select().where(JOBS.c.number.in_(numbers)).order_by(JOBS.c.number.desc())

    def _conditions(self) -> list[ColumnElement[bool]]:
        """Return the exact conditions, which need no index."""
        found: list[ColumnElement[bool]] = []
        if self.label is not None:
            name, text = self.label
            found.append(JOBS.c.labels[name].as_string() == text)
        if self.outcome is not None:
            found.append(JOBS.c.result["outcome"].as_string() == self.outcome)
        if self.text is not None:
            found.append(_contains(self.text))
        if self.created_from is not None or self.created_to is not None:
            # With both bounds SQLite takes the index that has the times.
            found.append(JOBS.c.created_at >= (self.created_from or FIRST))
            found.append(JOBS.c.created_at < (self.created_to or LAST))
        return found

    def _found_in_file(self) -> list[ColumnElement[bool]]:
        """Return conditions on the full-text index that all matching jobs meet."""
        phrases: list[str] = []
        found: list[ColumnElement[bool]] = []
        if self.label is not None:
            phrases.append(": ".join(_quoted(text) for text in self.label))
        if self.outcome is not None:
            phrases.append(f'"outcome": {_quoted(self.outcome)}')
        if self.text is not None and "\0" not in self.text:  # NUL ends a query of FTS5
            if len(self.text) >= TRIGRAM:
                phrases.append(self.text)
            else:
                found.append(JOB_SEARCH.c.words.icontains(self.text, autoescape=True))
        if phrases:
            terms = " AND ".join('"' + phrase.replace('"', '""') + '"' for phrase in phrases)
            found.append(JOB_SEARCH.c.words.match(terms))
        return found

    def _found_on_server(self) -> list[ColumnElement[bool]]:
        """Return conditions for the indexes of a server that all matching jobs meet."""
        # A journal in a file does not need this dialect, which takes 4 MB.
        from sqlalchemy.dialects.postgresql import JSONB

        found: list[ColumnElement[bool]] = []
        if self.label is not None:
            found.append(cast(JOBS.c.labels, JSONB).contains(dict([self.label])))
        if self.outcome is not None:
            found.append(OUTCOME_ON_SERVER.in_([self.outcome]))
        if self.text is not None:
            found.append(WORDS_ON_SERVER.icontains(self.text, autoescape=True))
        return found


def _quoted(text: str) -> str:
    """Return a text as JSON in the journal's format."""
    return json.dumps(text, ensure_ascii=False)


def _contains(text: str) -> ColumnElement[bool]:
    columns = [JOBS.c.sample, JOBS.c.batch, JOBS.c.operator, JOBS.c.notes]
    labels = cast(JOBS.c.labels, String)
    places = [JOBS.c.id, JOBS.c.cause, JOBS.c.requested_by, *columns, labels]
    return or_(*(place.icontains(text, autoescape=True) for place in places))


EVERY_JOB = JobFilter()
"""Filter that matches all jobs of a journal."""
