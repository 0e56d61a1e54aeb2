"""A supervisor of a virtual rig on which any action is allowed, and the invariants that must
hold."""

import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from hypothesis.stateful import RuleBasedStateMachine, invariant

from pincette.api.events import Event
from pincette.api.requests import JobRequest
from pincette.api.states import STATES, ActionType, JobState
from pincette.config.reading import laid_over
from pincette_supervisor.jobs.job_monitor import deadline_s
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.motions import ReleaseJobRequest
from pincette_supervisor.plugin import Planned, kind_of
from pincette_supervisor.problems import ProblemError
from tests.support.grips import SHORT
from tests.support.office import Office
from tests.support.rigs import demo_rig
from tests.support.steps import KilledError
from tests.support.told_states import states_told
from tests.support.virtual_rig import VirtualRig

REFUSED = (409, 422, 503)
"""Status codes that the OpenAPI document allows for a refused job or action."""
RIG = laid_over(SHORT, {"simulation": {"scripts": True}})
ENDS = {state for state, row in STATES.items() if row.terminal}
RELEASE = ReleaseJobRequest(kind="release", autostart=True)
ENDING_S = 10.0
"""Time within which a job that releases its part ends, and a stopped arm is at rest, in s."""
SLACK_TICKS = 3
"""Ticks after which a supervisor that sees each of them has noticed an expired deadline."""


class Explored(RuleBasedStateMachine):
    """The rig, its supervisor, and the invariants that hold whatever is done to them."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.data = Path(self.folder.name)
        self.rig = VirtualRig(demo_rig(RIG, time="lockstep"), self.data)
        self.office = Office(self.rig, self.data)
        self.ended: dict[str, JobState] = {}

    def restart(self, *, in_order: bool = False) -> None:
        """Start another supervisor in place of the one that has ended or was killed."""
        if in_order and not self.office.steps.killed:
            self.office.end()
        else:
            self.office.kill()
        self.office = Office(self.rig, self.data)

    @invariant()
    def the_journal_agrees_with_the_table(self) -> None:
        reported, rows = self._events(), self.rows()
        while (
            later := self._events()
        ) != reported:  # the journal's thread wrote between the two reads
            reported, rows = later, self.rows()
        assert [row.number for row in reported] == list(range(1, len(reported) + 1))
        assert {row.id: row.state for row in rows} == states_told(reported)

    def _events(self) -> list[Event]:
        return self.office.store.events_after(0, limit=100_000)

    @invariant()
    def no_thread_dies(self) -> None:
        assert self.office.faults == []

    @invariant()
    def an_end_is_an_end(self) -> None:
        for row in self.rows():
            assert self.ended.get(row.id, row.state) == row.state
            if row.state in ENDS:
                self.ended[row.id] = row.state

    @invariant()
    def one_job_has_the_rig(self) -> None:
        alive = [row for row in self.rows() if row.state not in ENDS]
        queued = [row for row in alive if row.state == "queued"]
        assert len(alive) - len(queued) <= 1
        assert len(queued) == len(self.office.manager.queue)

    @invariant()
    def no_state_lasts_beyond_its_deadline(self) -> None:
        live = self.office.manager.active
        if live is None:
            return
        policy = kind_of(live.request).stop_of(live.request)
        limit_s = deadline_s(live.status.state, live.planned, self.rig.rig, policy)
        if limit_s is not None and live.status.state != "running":
            slack_s = SLACK_TICKS * self.rig.rig.rig.period_s
            assert self.rig.now_s - live.status.entered_at <= limit_s + slack_s, live.status.state

    def teardown(self) -> None:
        try:
            self.office.store.writes_left = None
            self.the_journal_agrees_with_the_table()
            self._every_stop_ends()
            self.the_journal_agrees_with_the_table()
            self.an_end_is_an_end()
        finally:
            if not self.office.steps.killed:
                self.office.end()
            self.rig.close()
            self.folder.cleanup()

    def _every_stop_ends(self) -> None:
        """Stop all and release the held part; then nothing plays any more."""
        for target in ("sensor", "output"):
            self.rig.order(target, "heal", None, None)
        self.office.manager.control_queue("clear", "test")
        live = self.office.manager.active
        if live is not None and not live.status.terminal:
            self.ask(self.row(live.id), "stop")
            self.pass_until_it_ends(live.id)
        assert {row.state for row in self.rows()} <= ENDS
        if live is not None and not live.done.wait(ENDING_S):
            assert live.status.held
            self.ask(self.row(live.id), "release")
            assert live.done.wait(ENDING_S)
        if self.rig.applied and self.rig.applied[-1].part_held:
            # The part belongs to a job whose supervisor was killed: only another job can release
            # it.
            self.tried(lambda: self.office.manager.create(RELEASE))
            live = self.office.manager.active
            assert live is None or live.done.wait(ENDING_S), live.status.state
        assert self._falls_silent(), self.rig.applied[-1]

    def _falls_silent(self) -> bool:
        """Return whether the loop comes to rest: in lockstep, a loop that plays nothing
        publishes nothing."""
        until_s = self.rig.now_s + ENDING_S
        while self.rig.now_s < until_s:
            stated = len(self.rig.applied)
            self.office.steps.pass_()
            if len(self.rig.applied) == stated:
                return True
        return False

    def pass_until_it_ends(self, job: str) -> None:
        live = self.office.manager.active
        assert live is not None
        deadline_s = self.rig.now_s + self._longest_s(live.request, live.planned)
        while not self.office.manager.index.is_over(job):
            assert self.rig.now_s <= deadline_s, f"still {self.row(job).state}"
            self.tried(self.office.steps.pass_)

    def _longest_s(self, request: JobRequest, planned: Planned | None) -> float:
        """Return how long a stop may take, including an abort that it causes."""
        policy = kind_of(request).stop_of(request)
        limits_s = [
            deadline_s(state, planned, self.rig.rig, policy) or 0.0
            for state in ("stopping", "aborting")
        ]
        return sum(limits_s) + SLACK_TICKS * self.rig.rig.rig.period_s

    def ask(self, row: JobRow, action: ActionType) -> None:
        """Request an action; one that the table does not offer is refused and changes nothing."""
        manager = self.office.manager

        def act() -> None:
            allowed = manager.index.job(row.id).allowed_actions
            _, holds = manager.perform(row.id, action, "test")
            assert holds or action in allowed

        self.tried(act)

    def tried(self, deed: Callable[[], object]) -> None:
        """Do something that may be refused and that may kill the supervisor."""
        refusal: ProblemError | None = None
        with suppress(KilledError):
            try:
                deed()
            except ProblemError as problem:
                refusal = problem
            self.office.steps.settle()
        assert refusal is None or refusal.status in REFUSED, refusal
        if self.office.steps.killed:
            self.restart()

    def rows(self) -> list[JobRow]:
        """Return all jobs, the newest first."""
        return self.office.store.newest(1000)

    def row(self, job: str) -> JobRow:
        row = self.office.store.get(job)
        assert row is not None
        return row

    def state(self) -> JobState | None:
        """Return the state of the job that occupies the rig."""
        live = self.office.manager.active
        return None if live is None else live.status.state
