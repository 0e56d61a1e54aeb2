"""The rigs of one supervisor: its own, and those that were found on the router."""

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from pincette.api.job_models import Job
from pincette.api.request_models import AnyJobRequest
from pincette.config.rig_file import JOINED
from pincette_supervisor import problems
from pincette_supervisor.journal.store import JobRow, Store
from pincette_supervisor.problems import ProblemError
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.job_view import job_view
from pincette_supervisor.running.refusals import unready

T = TypeVar("T")


class Rigs:
    """Each rig by its name, the supervisor's own first. Asks no bus, so no rig delays another."""

    def __init__(self, own: Conductor) -> None:
        self.own = own
        self._lock = threading.Lock()
        self._conductors: Mapping[str, Conductor] = {own.name: own}
        self._unusable: Mapping[str, str] = {}

    @property
    def store(self) -> Store:
        """The journal of all."""
        return self.own.site.store

    @property
    def unusable(self) -> Mapping[str, str]:
        """Rigs that were found and cannot be served, with the reason."""
        return self._unusable

    def put(self, conductor: Conductor) -> None:
        """Serve a rig, in place of what has served it before."""
        with self._lock:
            self._conductors = {**self._conductors, conductor.name: conductor}
            self._unusable = {
                rig: why for rig, why in self._unusable.items() if rig != conductor.name
            }

    def put_unusable(self, rig: str, why: str) -> None:
        """Say why a rig that was found is not served; empty: it has gone."""
        with self._lock:
            others = {name: other for name, other in self._unusable.items() if name != rig}
            self._unusable = {**others, rig: why} if why else others

    def all(self) -> list[Conductor]:
        """Every rig that is served, the own first."""
        return list(self._conductors.values())

    def known(self, rig: str) -> Conductor | None:
        """A rig by its name; None where it is not served."""
        return self._conductors.get(rig)

    def get(self, rig: str) -> Conductor:
        """A rig by its name; raises ProblemError where it is not served."""
        found = self.known(rig)
        if found is not None:
            return found
        why = self._unusable.get(rig)
        raise unready([why]) if why else problems.not_found("rig", rig, list(self._conductors))

    def chosen(self, rig: str | None) -> Conductor:
        """The rig that a request names, or the only one; raises ProblemError."""
        if rig is not None:
            return self.get(rig)
        if len(self._conductors) == 1:
            return self.own
        words = f"rig is missing: name one of {', '.join(self._conductors)}"
        raise ProblemError(
            422,
            "invalid-request",
            "It is not said which rig is meant",
            words,
            errors=[{"pointer": "/rig", "message": words}],
        )

    def of_request(self, request: AnyJobRequest, key: str | None) -> Conductor:
        """Who takes a job: whoever has taken it already under this key, or the rig it names."""
        known = None if key is None else self.store.created(key)
        return self.chosen(request.rig) if known is None else self.of_job(known.job)

    def of_row(self, rig: str) -> Conductor:
        """Who answers for what is kept of a rig: its own, where the rig is not served."""
        return self.known(rig) or self.own

    def of_job(self, name: str) -> Conductor:
        """Who answers for a job, or says that there is none."""
        row = self.store.get(name)
        return self.own if row is None else self.of_row(row.rig)

    def having(self, job: str) -> Conductor:
        """Who has a job that is not over; looks at no store."""
        return next((one for one in self.all() if one.has(job)), self.own)

    def job(self, name: str) -> Job:
        """One job as it is; raises ProblemError where there is none of this name."""
        return self._view(self._row(name))

    def jobs(self, limit: int, *, before: str | None = None, **filters: Any) -> list[Job]:
        """Jobs of all rigs, the newest first; see ``Store.newest``; raises ProblemError."""
        number = None if before is None else self._row(before).number
        rows = self.store.newest(limit, before_number=number, **filters)
        return [self._view(row) for row in rows]

    def _row(self, name: str) -> JobRow:
        row = self.store.get(name)
        if row is None:
            raise problems.not_found("job", name)
        return row

    def _view(self, row: JobRow) -> Job:
        conductor = self.known(row.rig)
        if conductor is None:
            return job_view(row, None, None, self.records(row.rig))
        return conductor.view(row)

    def records(self, rig: str) -> Path:
        """Folder of a rig's records, also of one that is not served at present."""
        conductor, own = self.known(rig), self.own.site.records
        if conductor is not None:
            return conductor.site.records
        joined = own.parent / JOINED / rig / own.name
        return joined if joined.is_dir() else own

    def of_all(self, what: Callable[[Conductor], T]) -> list[T]:
        """Ask something of every rig, side by side, so that slow ones are waited for once."""
        everyone = self.all()
        if len(everyone) == 1:
            return [what(self.own)]
        with ThreadPoolExecutor(len(everyone), thread_name_prefix="rigs") as threads:
            return list(threads.map(what, everyone))

    def close(self) -> None:
        """End the jobs of all rigs, side by side."""
        self.of_all(Conductor.close)

    def release(self) -> None:
        """Let go of what they have been served with."""
        for conductor in self.all():
            conductor.release()
