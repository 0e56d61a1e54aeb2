"""The blocking client: the methods of the asynchronous client, executed in the caller's thread.

Over a ``BlockingConnection`` a coroutine of the client never suspends. One ``send(None)`` runs it
to its end in the caller's thread, without an event loop or a second thread. It therefore works in a
script, in a thread, and in a notebook whose event loop is already running.
"""

from collections.abc import AsyncGenerator, Callable, Coroutine, Iterator
from contextlib import suppress
from functools import wraps
from pathlib import Path
from types import TracebackType
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, overload

import httpx

from pincette.api.jobs import Job, Progress
from pincette.api.results import JobResult
from pincette.api.series import Series, SeriesState
from pincette.api.states import JobState
from pincette.client.call import PATIENCE_S
from pincette.client.errors import ClientError
from pincette.client.job import AsyncJobHandle
from pincette.client.notebook import job_html, rigs_html
from pincette.client.rig import AsyncRigHandle
from pincette.client.series import AsyncSeriesHandle
from pincette.client.status import NEWS_S, status_of
from pincette.client.supervisor import TIMEOUT_S, AsyncSupervisor
from pincette.client.transport import BlockingConnection, Transport, client_settings

A = TypeVar("A")
P = ParamSpec("P")
R = TypeVar("R")
S = TypeVar("S")


def run(coroutine: Coroutine[Any, Any, R]) -> R:
    """Run a coroutine that does not suspend; raises RuntimeError if it does."""
    try:
        coroutine.send(None)
    except StopIteration as done:
        return done.value
    coroutine.close()
    raise RuntimeError(
        "a call of the blocking client tried to wait: its connection is asynchronous"
    )


def _items(stream: AsyncGenerator[R]) -> Iterator[R]:
    try:
        while True:
            try:
                item = run(stream.__anext__())
            except StopAsyncIteration:
                return
            yield item
    finally:
        run(stream.aclose())


class Blocking(Generic[A]):
    """Blocking form of an object of the asynchronous client."""

    def __init__(self, asynchronous: A) -> None:
        self.asynchronous = asynchronous

    def __repr__(self) -> str:
        return repr(self.asynchronous)


@overload
def blocking(
    method: Callable[Concatenate[A, P], Coroutine[Any, Any, R]],
) -> Callable[Concatenate[Blocking[A], P], R]: ...
@overload
def blocking(
    method: Callable[Concatenate[A, P], Coroutine[Any, Any, R]], wrap: Callable[[R], S]
) -> Callable[Concatenate[Blocking[A], P], S]: ...
def blocking(
    method: Callable[Concatenate[A, P], Coroutine[Any, Any, Any]],
    wrap: Callable[[Any], Any] | None = None,
) -> Callable[Concatenate[Blocking[A], P], Any]:
    """Return the blocking form of a coroutine method; ``wrap`` also makes returned handles
    blocking.
    """

    @wraps(method)
    def call(self: Blocking[A], /, *args: P.args, **kwargs: P.kwargs) -> Any:
        value = run(method(self.asynchronous, *args, **kwargs))
        return value if wrap is None else wrap(value)

    return call


def iterator(
    method: Callable[Concatenate[A, P], AsyncGenerator[R]],
) -> Callable[Concatenate[Blocking[A], P], Iterator[R]]:
    """Return the blocking form of a method that returns a stream."""

    @wraps(method)
    def call(self: Blocking[A], /, *args: P.args, **kwargs: P.kwargs) -> Iterator[R]:
        return _items(method(self.asynchronous, *args, **kwargs))

    return call


class JobHandle(Blocking[AsyncJobHandle]):
    """One job: its state, its actions and its result."""

    @property
    def job(self) -> Job:
        """State of the job in the newest reply of the supervisor."""
        return self.asynchronous.job

    @property
    def id(self) -> str:
        """Identifier of the job."""
        return self.job.id

    @property
    def state(self) -> JobState:
        """State of the job in the newest reply; ``refresh`` requests a new one."""
        return self.job.state

    @property
    def ended(self) -> bool:
        """True if the job had ended in the newest reply."""
        return self.asynchronous.ended

    def _repr_html_(self) -> str:
        """Return a table of the newest reply, with the plot of the record if the job has ended."""
        picture = None
        if self.ended:
            with suppress(ClientError):
                picture = self.patient(0.0).picture()
        return job_html(self.job, picture)

    def patient(self, patience_s: float) -> "JobHandle":
        """Return a copy of this job that retries for this time, in s, when no supervisor
        replies.
        """
        return JobHandle(self.asynchronous.patient(patience_s))

    def result(self) -> JobResult | None:
        """Return the result of the job; None if the job has not moved the arm."""
        return self.asynchronous.result()

    refresh = blocking(AsyncJobHandle.refresh)
    wait = blocking(AsyncJobHandle.wait)
    recorded = blocking(AsyncJobHandle.recorded)
    start = blocking(AsyncJobHandle.start)
    pause = blocking(AsyncJobHandle.pause)
    resume = blocking(AsyncJobHandle.resume)
    stop = blocking(AsyncJobHandle.stop)
    abort = blocking(AsyncJobHandle.abort)
    release = blocking(AsyncJobHandle.release)
    proceed = blocking(AsyncJobHandle.proceed)
    act = blocking(AsyncJobHandle.act)
    describe = blocking(AsyncJobHandle.describe)
    delete_record = blocking(AsyncJobHandle.delete_record)
    events = iterator(AsyncJobHandle.events)
    to_hold = iterator(AsyncJobHandle.to_hold)
    to_success = iterator(AsyncJobHandle.to_success)
    to_release = iterator(AsyncJobHandle.to_release)
    artifacts = blocking(AsyncJobHandle.artifacts)
    picture = blocking(AsyncJobHandle.picture)
    download = blocking(AsyncJobHandle.download)


def _optional(job: AsyncJobHandle | None) -> JobHandle | None:
    return None if job is None else JobHandle(job)


def _all(jobs: list[AsyncJobHandle]) -> list[JobHandle]:
    return [JobHandle(job) for job in jobs]


def _reached(found: tuple[AsyncJobHandle, Progress | None]) -> tuple[JobHandle, Progress | None]:
    job, kept = found
    return JobHandle(job), kept


class SeriesHandle(Blocking[AsyncSeriesHandle]):
    """One series: its state, its actions, its jobs and its report."""

    @property
    def series(self) -> Series:
        """State of the series in the newest reply of the supervisor."""
        return self.asynchronous.series

    @property
    def id(self) -> str:
        """Identifier of the series."""
        return self.series.id

    @property
    def state(self) -> SeriesState:
        """State of the series in the newest reply; ``refresh`` requests a new one."""
        return self.series.state

    def patient(self, patience_s: float) -> "SeriesHandle":
        """Return a copy of this series that retries for this time, in s, when no supervisor
        replies.
        """
        return SeriesHandle(self.asynchronous.patient(patience_s))

    refresh = blocking(AsyncSeriesHandle.refresh)
    wait = blocking(AsyncSeriesHandle.wait)
    pause = blocking(AsyncSeriesHandle.pause)
    resume = blocking(AsyncSeriesHandle.resume)
    stop = blocking(AsyncSeriesHandle.stop)
    act = blocking(AsyncSeriesHandle.act)
    jobs = blocking(AsyncSeriesHandle.jobs, _all)
    table = blocking(AsyncSeriesHandle.table)
    report = blocking(AsyncSeriesHandle.report)
    picture = blocking(AsyncSeriesHandle.picture)


class RigHandle(Blocking[AsyncRigHandle]):
    """One rig: its state, its plans, its jobs and its emergency stop."""

    @property
    def name(self) -> str:
        """Name of the rig in its rig file."""
        return self.asynchronous.name

    def _repr_html_(self) -> str:
        """Return a table of the rig's present state, with the force and its uncertainty."""
        return rigs_html({self.name: self.status()})

    def patient(self, patience_s: float) -> "RigHandle":
        """Return a copy of this rig that retries for this time, in s, when no supervisor
        replies.
        """
        return RigHandle(self.asynchronous.patient(patience_s))

    state = blocking(AsyncRigHandle.state)
    status = blocking(AsyncRigHandle.status)
    can_start = blocking(AsyncRigHandle.can_start)
    plan = blocking(AsyncRigHandle.plan)
    plot = blocking(AsyncRigHandle.plot)
    start = blocking(AsyncRigHandle.start, JobHandle)
    start_series = blocking(AsyncRigHandle.start_series, SeriesHandle)
    plan_series = blocking(AsyncRigHandle.plan_series)
    series = blocking(AsyncRigHandle.series)
    jobs = blocking(AsyncRigHandle.jobs, _all)
    job = blocking(AsyncRigHandle.job, JobHandle)
    stop = blocking(AsyncRigHandle.stop)
    reach = blocking(AsyncRigHandle.reach, _reached)
    plan_reach = blocking(AsyncRigHandle.plan_reach)
    let_go = blocking(AsyncRigHandle.let_go, JobHandle)
    active_job = blocking(AsyncRigHandle.active_job, _optional)
    events = iterator(AsyncRigHandle.events)
    live = iterator(AsyncRigHandle.live)
    estop = blocking(AsyncRigHandle.estop)
    reset = blocking(AsyncRigHandle.reset)
    claim = blocking(AsyncRigHandle.claim)
    give_back = blocking(AsyncRigHandle.give_back)
    queue = blocking(AsyncRigHandle.queue)
    move = blocking(AsyncRigHandle.move)
    places = blocking(AsyncRigHandle.places)
    timing = blocking(AsyncRigHandle.timing)
    simulate = blocking(AsyncRigHandle.simulate)
    model = blocking(AsyncRigHandle.model)
    checklist = blocking(AsyncRigHandle.checklist)
    use_model = blocking(AsyncRigHandle.use_model)
    learning = blocking(AsyncRigHandle.learning)
    erase_learning = blocking(AsyncRigHandle.erase_learning)


class Supervisor(Blocking[AsyncSupervisor]):
    """Entry point: ``Supervisor(url).rig()``; same parameters as ``AsyncSupervisor``."""

    def __init__(
        self,
        url: str,
        *,
        timeout_s: float = TIMEOUT_S,
        patience_s: float = PATIENCE_S,
        operator: str | None = None,
        key: str | None = None,
        claim: str | None = None,
        authority: Path | None = None,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        settings = client_settings(url, operator, key, authority, claim)
        connection = BlockingConnection(httpx.Client(**settings, transport=transport))
        asynchronous = AsyncSupervisor.__new__(AsyncSupervisor)
        asynchronous.transport = Transport(url, connection, timeout_s, patience_s)
        super().__init__(asynchronous)

    @property
    def transport(self) -> Transport:
        """Object that sends the calls; its clock and its sleep may be replaced."""
        return self.asynchronous.transport

    def _repr_html_(self) -> str:
        """Return a table of the rigs that the supervisor serves."""
        now = self.patient(0.0).within(NEWS_S)
        return rigs_html({rig.name: status_of(rig) for rig in now.rigs()})

    def __enter__(self) -> "Supervisor":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def patient(self, patience_s: float) -> "Supervisor":
        """Return a copy of this supervisor that retries for this time, in s, when it does not
        reply.
        """
        other = Supervisor.__new__(Supervisor)
        other.asynchronous = self.asynchronous.patient(patience_s)
        return other

    def within(self, timeout_s: float) -> "Supervisor":
        """Return a copy of this supervisor with another time limit for each reply, in s."""
        other = Supervisor.__new__(Supervisor)
        other.asynchronous = self.asynchronous.within(timeout_s)
        return other

    close = blocking(AsyncSupervisor.close)
    rigs = blocking(AsyncSupervisor.rigs)
    rig = blocking(AsyncSupervisor.rig, RigHandle)
    job = blocking(AsyncSupervisor.job, JobHandle)
    stop = blocking(AsyncSupervisor.stop)
    jobs = blocking(AsyncSupervisor.jobs, _all)
    find_series = blocking(AsyncSupervisor.find_series, SeriesHandle)
    series = blocking(AsyncSupervisor.series)
    export = blocking(AsyncSupervisor.export)
    events = iterator(AsyncSupervisor.events)
    estop = blocking(AsyncSupervisor.estop)
    proposals = blocking(AsyncSupervisor.proposals)
    proposal = blocking(AsyncSupervisor.proposal)
    decide = blocking(AsyncSupervisor.decide)
    recipes = blocking(AsyncSupervisor.recipes)
    recipe = blocking(AsyncSupervisor.recipe)
    save_recipe = blocking(AsyncSupervisor.save_recipe)
    alarms = blocking(AsyncSupervisor.alarms)
    acknowledge = blocking(AsyncSupervisor.acknowledge)
    session = blocking(AsyncSupervisor.session)
    audit = blocking(AsyncSupervisor.audit)
    audit_chain = blocking(AsyncSupervisor.audit_chain)
