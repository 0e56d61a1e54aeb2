"""Which jobs of the journal are asked for."""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Select, String, cast, or_

from pincette.api.states import JobState
from pincette_supervisor.journal.database import matching
from pincette_supervisor.journal.tables import JOBS


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFilter:
    """What jobs must be; what is None leaves them open."""

    kind: str | None = None
    state: JobState | None = None
    rig: str | None = None
    label: tuple[str, str] | None = None
    """Name and value."""
    outcome: str | None = None
    sample: str | None = None
    batch: str | None = None
    operator: str | None = None
    pinned: bool | None = None
    text: str | None = None
    """Part of the name, of what was said of it, of the cause, or of who asked; small and capital
    letters are the same where they are ASCII."""
    created_from: str | None = None
    """Taken then or later; in UTC, as the journal keeps times."""
    created_to: str | None = None
    """Taken before then."""
    before_number: int | None = None

    def applied(self, query: Select[Any]) -> Select[Any]:
        """The query of those jobs alone."""
        query = matching(query, kind=self.kind, state=self.state, rig=self.rig)
        query = matching(query, sample=self.sample, batch=self.batch, operator=self.operator)
        query = matching(query, pinned=self.pinned)
        return query.where(*self._conditions())

    def _conditions(self) -> list[ColumnElement[bool]]:
        found: list[ColumnElement[bool]] = []
        if self.label is not None:
            name, text = self.label
            found.append(JOBS.c.labels[name].as_string() == text)
        if self.outcome is not None:
            found.append(JOBS.c.result["outcome"].as_string() == self.outcome)
        if self.text is not None:
            found.append(_contains(self.text))
        if self.created_from is not None:
            found.append(JOBS.c.created_at >= self.created_from)
        if self.created_to is not None:
            found.append(JOBS.c.created_at < self.created_to)
        if self.before_number is not None:
            found.append(JOBS.c.number < self.before_number)
        return found


def _contains(text: str) -> ColumnElement[bool]:
    said = [JOBS.c.sample, JOBS.c.batch, JOBS.c.operator, JOBS.c.notes]
    labels = cast(JOBS.c.labels, String)
    places = [JOBS.c.id, JOBS.c.cause, JOBS.c.requested_by, *said, labels]
    return or_(*(place.icontains(text, autoescape=True) for place in places))


EVERY_JOB = JobFilter()
