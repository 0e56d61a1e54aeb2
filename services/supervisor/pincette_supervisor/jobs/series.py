"""Runs the series of a rig: starts jobs one after the other, and pauses or stops a series if
necessary.

A series holds no state that a restart could lose: its requests are in the journal, and the key of
each job, stored together with the job, names the series and the number.
"""

import json
import logging
import secrets
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from typing import TYPE_CHECKING, Any, cast

from pincette.api.jobs import DESCRIPTION
from pincette.api.requests import JobRequest
from pincette.api.series import (
    SERIES_LABEL,
    SERIES_STATES,
    TARGETS,
    Series,
    SeriesActionType,
    SeriesJob,
    SeriesPlan,
    SeriesRequest,
    SeriesState,
    SeriesSummary,
    allowed_series_actions,
)
from pincette.api.states import STATES, JobState
from pincette_supervisor import problems
from pincette_supervisor.jobs import refusals
from pincette_supervisor.jobs.job_index import fingerprint_of, new_id
from pincette_supervisor.jobs.series_jobs import request_of, requests_of
from pincette_supervisor.journal.series import SeriesRepository, SeriesRow, SeriesRun, key_of
from pincette_supervisor.journal.store import JobRow, StoreError, utc_now
from pincette_supervisor.plugin import kind_of
from pincette_supervisor.problems import ProblemError

if TYPE_CHECKING:
    from pincette_supervisor.jobs.job_manager import JobManager

log = logging.getLogger(__name__)
LOOK_S = 0.1
"""Interval of the checks whether a job has ended, in s."""
READY_S = 30.0
"""Time for which the start of a job is retried while the rig is not ready, for example after a
restart, in s.
"""
RECORD_S = 30.0
"""Longest wait for the record of the last job, in s."""
RESTARTED = "the supervisor was restarted"
PACED = 20
"""Number of the last jobs whose duration is compared with the planned one."""


class SeriesRunner:
    """The series of one rig; at most one of them is running."""

    def __init__(self, manager: "JobManager") -> None:
        self._manager, self._context = manager, manager.context
        self.repository = SeriesRepository(manager.context.store)
        self._lock = threading.RLock()
        self._row: SeriesRow | None = None
        """The series that was started or resumed last."""
        self._key: str | None = None
        """Key under which the newest job of this series is created."""
        self._claim: str | None = None
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None
        self._closing = False

    @property
    def running(self) -> bool:
        """Return whether a series is running."""
        return self._row is not None and self._row.state == "running"

    def recover(self) -> None:
        """Pause the series that an earlier supervisor left running, or continue it."""
        rig = self._manager.name
        for row in self.repository.newest(1, rig=rig, state="running"):
            self._row = row
            waits = any(run.state == "queued" for run in self.repository.runs(row.id))
            if row.request.get("after_restart") == "continue" and not waits:
                self._begin(row, None)
            else:
                self._settle(row, "paused", RESTARTED)

    def plan(self, request: SeriesRequest, *, predict: bool = True) -> SeriesPlan:
        """Plan all jobs of a series, each different one once; raises ProblemError."""
        return _plan_of(self._planned(request, predict=predict), request.pause_s)

    def create(
        self,
        request: SeriesRequest,
        key: str | None,
        *,
        by: str,
        claim: str | None,
        trace: str | None = None,
    ) -> tuple[Series, bool]:
        """Create a series and start it; the flag is True if its key created it earlier.

        Raises ProblemError.
        """
        tree = request.model_dump(mode="json", exclude_unset=True)
        digest = fingerprint_of(tree)
        if key is not None and (known := self.repository.created(key)) is not None:
            return self._same(known, digest)
        self._manager.claims.require(claim)
        self._require_none_running()
        jobs = self._planned(request)
        row = SeriesRow(
            id=new_id(2),
            rig=self._manager.name,
            name=request.name,
            state="running",
            request=tree,
            jobs=jobs,
            created_at=utc_now(),
            key=key,
            fingerprint=digest,
            requested_by=by,
            traceparent=trace,
        )
        first = request_of(jobs[0]["request"])
        refusals.require_ready(self._context, begins_held=kind_of(first).begins_held, queued=True)
        self._require_no_part(first)
        with self._lock:
            self._require_none_running()
            row, is_new = self.repository.add(row)
            if not is_new:
                return self._same(row, digest)
            self._tell(row, by=by)
            self._begin(row, claim)
        return self.view(row), False

    def _same(self, known: SeriesRow, digest: str) -> tuple[Series, bool]:
        refusals.require_same("series", known.id, known.fingerprint, digest)
        return self.view(known), True

    def _require_none_running(self) -> None:
        if self._manager.closed:
            raise refusals.unready(["the supervisor is ending, or loads the rig again"])
        row = self._row
        if row is not None and row.state == "running":
            raise ProblemError(
                409,
                "series-active",
                "Another series is running",
                f"series {row.id} is running: wait for its end, or stop it",
                series=row.id,
            )

    def _require_no_part(self, request: JobRequest) -> None:
        """Raise ProblemError if an ended job holds a part that the next job cannot begin with."""
        live = self._manager.active
        if live is not None and live.status.keeps_part and not kind_of(request).begins_held:
            raise refusals.held_by(live)

    def _planned(self, request: SeriesRequest, *, predict: bool = False) -> list[dict[str, Any]]:
        """Return request and planned duration of each job; raises ProblemError.

        A recipe is replaced by its present version, so that all jobs have the same one.
        """
        known: dict[str, tuple[float | None, str | None]] = {}
        jobs: list[dict[str, Any]] = []
        for number, tree in enumerate(requests_of(request), start=1):
            differs = {name: tree[name] for name in tree if name not in ("labels", *DESCRIPTION)}
            digest = json.dumps(differs, sort_keys=True)
            if digest not in known:
                known[digest] = self._plan_one(request_of(tree), number, predict=predict)
            planned_s, recipe = known[digest]
            pinned = {} if recipe is None else {"recipe": recipe}
            jobs.append({"request": {**tree, **pinned}, "planned_s": planned_s})
        return jobs

    def _plan_one(
        self, request: JobRequest, number: int, *, predict: bool
    ) -> tuple[float | None, str | None]:
        """Return planned duration and pinned recipe of a job; raises ProblemError."""
        if kind_of(request).begins_held or request.plays is not None:
            return None, request.recipe  # its plan depends on earlier jobs
        try:
            resolved, planned = self._manager.feasible(request)
            if predict:
                refusals.require_feasible(self._manager.predictions.checked(planned))
        except ProblemError as error:
            error.detail = f"job {number}: {error.detail}"
            raise
        return planned.planned_s, resolved.kept.recipe

    def find(self, name: str) -> SeriesRow:
        """Return a series of the journal; raises ProblemError if there is none of this id."""
        row = self._row
        if row is not None and row.id == name:  # also while the journal lags behind
            return row
        return require_series(self.repository, name)

    async def wait_over(self, name: str, timeout_s: float) -> None:
        """Wait until a series is not running, or for the timeout."""

        def over() -> bool:
            row = self._row
            return row is None or row.id != name or row.state != "running"

        await self._manager.changes.wait(over, timeout_s)

    def perform(
        self, name: str, action: SeriesActionType, *, by: str, claim: str | None
    ) -> tuple[Series, bool]:
        """Perform an action; the flag is True if nothing was left to do; raises ProblemError."""
        with self._lock:
            row = self.find(name)
            if row.state == TARGETS[action]:
                return self.view(row), True
            if action not in SERIES_STATES[row.state].actions:
                raise ProblemError(
                    409,
                    "invalid-transition",
                    "The state of the series does not allow this action",
                    f"a series that is {row.state} cannot {action}",
                    state=row.state,
                    allowed_actions=allowed_series_actions(row.state),
                )
            if action == "resume":
                self._manager.claims.require(claim)
                self._require_none_running()
                if (number := next_number(self.repository.runs(name))) <= len(row.jobs):
                    self._require_no_part(request_of(row.jobs[number - 1]["request"]))
                self._row = row
                row = self._change(row, "running", by, failures=0, ended_at=None, cause="")
                self._begin(row, claim)
            else:
                self._settle(row, TARGETS[action], f"{action} by {by}", by)
                if action == "stop":
                    self._stop_job(row, by)
        return self.view(self.find(name)), False

    def _stop_job(self, row: SeriesRow, by: str) -> None:
        """Stop the newest job of a series, also while it is being planned."""
        job: str | None = None
        if self._key is not None and self._row is not None and self._row.id == row.id:
            self._manager.turns.stop(self._key)
            job = self._manager.turns.created(self._key)
        else:
            job = next((run.job for run in reversed(self.repository.runs(row.id))), None)
        if job is not None and not self._manager.index.is_over(job):
            with suppress(ProblemError):  # it has ended meanwhile, or is aborting
                self._manager.perform(job, "stop", by)

    def close(self) -> None:
        """Start no further job; a running series goes on with the next supervisor."""
        self._closing = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join(1.0)

    def key_of_next(self, job: str) -> str | None:
        """Return the key for a job that continues one of the running series; None for others."""
        key, row = self._key, self._row
        if key is None or row is None or self._manager.turns.created(key) != job:
            return None
        self._key = key_of(row.id, int(key.split()[2]), secrets.token_hex(4))
        return self._key

    # The thread of the running series.

    def _begin(self, row: SeriesRow, claim: str | None) -> None:
        self._row, self._claim, self._key = row, claim, None
        self._wake.clear()
        before = self._thread
        self._thread = threading.Thread(target=self._run, args=[row.id, before], name=row.id)
        self._thread.start()

    def _run(self, name: str, before: threading.Thread | None) -> None:
        if before is not None:
            before.join()
        try:
            while self._goes_on(name) and self._step(name):
                pass
        except Exception as error:
            if self._closing:  # the journal may be closed already
                return
            log.exception("series %s is paused by a fault of the supervisor", name)
            self._pause(name, f"the supervisor has a fault, see its log: {error}")

    def _goes_on(self, name: str) -> bool:
        row = self._row
        return not self._closing and row is not None and row.id == name and row.state == "running"

    def _step(self, name: str) -> bool:
        """Run the next job to its end; return False if there is none, or it was not started."""
        row = self.find(name)
        runs = self.repository.runs(name)
        last = runs[-1] if runs else None
        if last is not None and not self._manager.index.is_over(last.job):
            return self._followed(name, last.job)  # the job was created before a pause
        number = next_number(runs)
        if number > len(row.jobs):
            if last is not None:
                self._wait(RECORD_S, lambda: self._manager.index.is_recorded(last.job))
            with self._lock:
                if self._goes_on(name):
                    self._settle(row, "completed", "")
            return False
        if last is not None and not self._paced(name, float(row.request.get("pause_s", 0.0))):
            return False
        job = self._start(name, number)
        return job is not None and self._followed(name, job)

    def _paced(self, name: str, pause_s: float) -> bool:
        self._wait(pause_s, lambda: not self._goes_on(name))
        return self._goes_on(name)

    def _start(self, name: str, number: int) -> str | None:
        """Create the job with a number, and return its id; if it is refused, pause the series."""
        row, tries_s = self.find(name), 0.0
        request = request_of(row.jobs[number - 1]["request"], series=name, number=number)
        while self._goes_on(name):
            with self._lock:
                self._key = key_of(name, number, secrets.token_hex(4))
            try:
                self._require_no_part(request)
                job, _ = self._manager.create(
                    request,
                    self._key,
                    by=row.requested_by,
                    gone=lambda: not self._goes_on(name),
                    claim=self._claim,
                    trace=row.traceparent,
                )
            except ProblemError as error:
                if error.code == "rig-not-ready" and tries_s < READY_S:
                    self._wait(1.0, lambda: not self._goes_on(name))
                    tries_s += 1.0
                    continue
                self._pause(name, f"job {number} was not started: {error}")
            except StoreError as error:
                self._pause(name, f"job {number} was not started: {error}")
            else:
                self._tell(row, number=number, job=job.id)
                return job.id
        return None

    def _followed(self, name: str, job: str) -> bool:
        """Wait for the end of a job; return whether the series goes on."""
        self._wait(None, lambda: self._manager.index.is_over(job))
        with self._manager.settled():  # wait until a job that continues this one exists
            newest = self.repository.runs(name)[-1].job
        if newest != job:
            return self._goes_on(name)
        ended = self._manager.index.job(job)
        words = f"job {job} {ended.state}: {ended.cause}".rstrip(": ")
        with self._lock:
            row = self.find(name)
            if not self._goes_on(name):
                return False
            if ended.state == "failed":
                self._failed(row, words)
            elif ended.state != "succeeded":
                self._settle(row, "paused", words)
        return self._goes_on(name)

    def _failed(self, row: SeriesRow, words: str) -> None:
        """Count a failed job, and apply the stop rule."""
        most, failures = row.request.get("stop_after_failures", 1), row.failures + 1
        if most is None or failures < most:
            self._change(row, "running", failures=failures)
            return
        before = f"{failures} jobs failed, the most that the series permits; the last: "
        cause = (before if most > 1 else "") + words
        self._settle(row, "stopped", cause, failures=failures)

    def _wait(self, timeout_s: float | None, over: Callable[[], bool]) -> None:
        """Wait until something is over, the supervisor ends, or a timeout has passed."""
        left_s = timeout_s
        while not (self._closing or over()) and (left_s is None or left_s > 0.0):
            wait_s = LOOK_S if left_s is None else min(LOOK_S, left_s)
            self._wake.wait(wait_s)
            left_s = None if left_s is None else left_s - wait_s

    def _pause(self, name: str, cause: str) -> None:
        with self._lock:
            if self._goes_on(name):
                self._settle(self.find(name), "paused", cause)

    def _settle(
        self, row: SeriesRow, state: SeriesState, cause: str, by: str = "", **values: Any
    ) -> None:
        ended_at = None if state == "paused" else utc_now()
        self._change(row, state, by, cause=cause, ended_at=ended_at, **values)

    def _change(self, row: SeriesRow, state: SeriesState, by: str = "", **values: Any) -> SeriesRow:
        """Change a series in memory, and in the journal as soon as that can be written."""
        row = replace(row, state=state, **values)
        if self._row is not None and self._row.id == row.id:
            self._row = row
        self._tell(row, by=by, change={"state": state, **values})
        self._manager.changes.notify_all()
        return row

    def _tell(
        self,
        row: SeriesRow,
        *,
        number: int | None = None,
        job: str | None = None,
        by: str = "",
        change: dict[str, Any] | None = None,
    ) -> None:
        """Append an event, with a change of the row if there is one."""
        body = {"series": row.id, "state": row.state, "cause": row.cause, "total": len(row.jobs)}
        body |= {"number": number, "by": by}
        log.info("series %s is %s", row.id, row.state, extra=body)

        def write() -> None:
            with self._context.events.transaction("series", job, **body):
                if change is not None:
                    self.repository.change(row.id, **change)

        self._context.write_queue.submit(write)

    # Forms in REST.

    def view(self, row: SeriesRow) -> Series:
        """Return a series with its jobs."""
        runs = self._runs(row)
        newest, tries = {run.number: run for run in runs}, Counter(run.number for run in runs)
        jobs = [
            _job(number, one, newest.get(number), tries[number])
            for number, one in _numbered(row.jobs)
        ]
        summary = self._summary(row, runs).model_dump()
        return Series(**summary, request=row.request, jobs=jobs, traceparent=row.traceparent)

    def summary(self, row: SeriesRow) -> SeriesSummary:
        """Return a series without its jobs."""
        return self._summary(row, self._runs(row))

    def _runs(self, row: SeriesRow) -> list[SeriesRun]:
        """Return the jobs of a series, oldest first, in their present states."""
        live = self._manager.index.newest
        return [
            replace(run, state=live.status.state, cause=live.status.cause)
            if live is not None and live.id == run.job
            else run
            for run in self.repository.runs(row.id)
        ]

    def _summary(self, row: SeriesRow, runs: list[SeriesRun]) -> SeriesSummary:
        newest = {run.number: run for run in runs}
        ended = [run for run in newest.values() if _is_terminal(run)]
        cause, halted = row.cause, self._manager.queue.halted
        if row.state == "running" and halted and runs and runs[-1].state == "queued":
            cause = f"job {runs[-1].job} waits in the queue, which is halted: {halted}"
        return SeriesSummary(
            id=row.id,
            name=row.name,
            rig=row.rig,
            state=row.state,
            cause=cause,
            total=len(row.jobs),
            ended=len(ended),
            failed=sum(run.state != "succeeded" for run in ended),
            job=runs[-1].job if runs else None,
            remaining_s=self._remaining_s(row, ended),
            allowed_actions=allowed_series_actions(row.state),
            by=row.requested_by,
            created_at=row.created_at,
            ended_at=row.ended_at,
        )

    def _remaining_s(self, row: SeriesRow, ended: list[SeriesRun]) -> float | None:
        """Return the remaining time, in s, estimated from planned durations and the pace of the
        last jobs.
        """
        over = {run.number for run in ended}
        left = [one["planned_s"] for number, one in _numbered(row.jobs) if number not in over]
        planned_s = _sum_s(left)
        if planned_s is None:
            return None
        pace = 1.0
        if row.state == "running":
            done = {run.job: run.number for run in ended[-PACED:] if run.state == "succeeded"}
            rows = self._context.store.several([*done])
            expected_s = _sum_s([row.jobs[done[one.id] - 1]["planned_s"] for one in rows])
            spent_s = sum(_spent_s(one) for one in rows)
            pace = spent_s / expected_s if expected_s else 1.0
            planned_s -= self._played_s(row)
        pauses = len(left) if over else max(0, len(left) - 1)
        pauses_s = pauses * float(row.request.get("pause_s", 0.0))
        return round(max(0.0, planned_s * pace) + pauses_s, 1)

    def _played_s(self, row: SeriesRow) -> float:
        """Return the time that the running job of a series has played, in s."""
        live = self._manager.index.newest
        if live is None or live.row.labels.get(SERIES_LABEL) != row.id or live.status.terminal:
            return 0.0
        return 0.0 if live.status.progress is None else live.status.progress.elapsed_s


def next_number(runs: Sequence[SeriesRun]) -> int:
    """Return the number of the next job after these jobs; the number of an interrupted job is
    repeated.
    """
    if not runs:
        return 1
    return runs[-1].number + (runs[-1].state != "interrupted")


def require_series(repository: SeriesRepository, name: str) -> SeriesRow:
    """Return a series of the journal; raises ProblemError if there is none of this id."""
    row = repository.get(name)
    if row is None:
        raise problems.not_found("series", name)
    return row


def _plan_of(jobs: list[dict[str, Any]], pause_s: float) -> SeriesPlan:
    planned_s = _sum_s([one["planned_s"] for one in jobs])
    return SeriesPlan(
        total=len(jobs),
        planned_s=None if planned_s is None else planned_s + pause_s * (len(jobs) - 1),
        jobs=[_job(number, one) for number, one in _numbered(jobs)],
    )


def _job(
    number: int, one: dict[str, Any], run: SeriesRun | None = None, tries: int = 0
) -> SeriesJob:
    return SeriesJob(
        number=number,
        **one,
        job=None if run is None else run.job,
        state=None if run is None else cast("JobState", run.state),
        cause="" if run is None else run.cause,
        tries=tries,
    )


def _numbered(jobs: list[dict[str, Any]]) -> Iterable[tuple[int, dict[str, Any]]]:
    return enumerate(jobs, start=1)


def _is_terminal(run: SeriesRun) -> bool:
    return STATES[cast("JobState", run.state)].terminal


def _sum_s(times_s: Sequence[float | None]) -> float | None:
    """Return the sum of durations; None if one is unknown."""
    known = [one for one in times_s if one is not None]
    return sum(known) if len(known) == len(times_s) else None


def _spent_s(row: JobRow) -> float:
    """Return the time from the request of a job to its end, in s."""
    if row.ended_at is None:
        return 0.0
    begun, ended = map(datetime.fromisoformat, (row.created_at, row.ended_at))
    return (ended - begun).total_seconds()
