"""Random walks over the state table by REST: no sequence of calls leaves it."""

import tempfile
import tomllib
from pathlib import Path
from typing import get_args
from unittest.mock import patch

import hypothesis.strategies as st
from hypothesis import HealthCheck, settings
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from pincette.api.states import STATES, ActionType, JobState
from pincette.config import parse_rig
from pincette.core.faults import Outcome
from tests.support.told_states import states_told

from .conftest import DEMO, blank
from .harness import Harness
from .test_awaiting_recovery import RECOVERY, ending_with, place

ACTIONS: tuple[ActionType, ...] = get_args(ActionType)
BEGIN = 40
"""Tick up to which a job plays without an action."""
PICTURE = "pincette_supervisor.results.archive.picture"


class Bench(RuleBasedStateMachine):
    """Random actions of a person at any time, on a rig that may fail."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        tables = tomllib.loads(DEMO.read_text(encoding="utf-8"))
        tables["rig"]["time"] = "lockstep"
        self.harness = Harness(parse_rig(tables), Path(self.folder.name), guard_s=1e6)
        self.harness.bus.pause_at, self.harness.bus.freezes = BEGIN, True
        # Drawing takes longer than all the rest.
        self.drawing = patch(PICTURE, blank)
        self.drawing.start()
        self.jobs: list[str] = []

    @initialize(finds=st.booleans())
    def begin(self, finds: bool) -> None:
        self.create(queue=False, autostart=True, finds=finds)

    @rule(queue=st.booleans(), autostart=st.booleans(), finds=st.booleans())
    def create(self, queue: bool, autostart: bool, finds: bool) -> None:
        self.harness.bus.pause_at = BEGIN
        self.harness.bus.edit = ending_with(Outcome.NONE if finds else Outcome.NO_CONTACT)
        body = {"kind": "grip", "autostart": autostart, "queue": queue, "recovery": RECOVERY}
        response = self.harness.post("/jobs", body)
        assert response.status_code in (201, 409, 503), response.text
        if response.status_code == 201:
            self.jobs.append(response.json()["id"])

    @precondition(lambda self: bool(self.jobs))
    @rule(action=st.sampled_from(ACTIONS), which=st.integers(0, 3))
    def act(self, action: ActionType, which: int) -> None:
        job = self.jobs[-1 - which % len(self.jobs)]
        before = self.harness.get(f"/jobs/{job}")
        requested = len(self.harness.bus.acts)
        body: dict[str, object] = {"type": action}
        if action == "retry_at":
            body["place"] = place(20.0)
        response = self.harness.post(f"/jobs/{job}/actions", body)
        assert response.status_code in (200, 202, 409), response.text
        if action not in before["allowed_actions"]:
            assert response.status_code in (200, 409)
        if (before["state"], action, response.status_code) == ("paused", "stop", 202):
            self.harness.until(lambda: len(self.harness.bus.acts) > requested)
            assert self.harness.bus.acts[requested:] == ["stop"]

    @rule(ticks=st.sampled_from((10, 700, 5000)))
    def play(self, ticks: int) -> None:
        bus = self.harness.bus
        with bus.turn:
            if bus.place < len(bus.ticks) and not bus.paused:
                bus.play(min(bus.place + ticks, len(bus.ticks)))

    @rule(rests=st.booleans())
    def safe_points_come(self, rests: bool) -> None:
        bus = self.harness.bus
        with bus.turn:
            waits = "pausing" in self._states() and not bus.paused
            bus.rests = rests
            if waits and rests and bus.place < len(bus.ticks):
                bus.rest()

    @rule()
    def fault(self) -> None:
        bus = self.harness.bus
        with bus.turn:
            if 0 < bus.place < len(bus.ticks):
                bus.trip("device: no answer")

    @precondition(lambda self: self.harness.bus.frozen)
    @rule()
    def thaw(self) -> None:
        self.harness.bus.thaw()

    @rule()
    def estop(self) -> None:
        assert self.harness.post("/rigs/demo/estop").status_code == 200

    @rule()
    def reset(self) -> None:
        assert self.harness.post("/rigs/demo/reset", {"acknowledge": True}).status_code == 200

    @rule(order=st.sampled_from(("resume", "clear")))
    def order_queue(self, order: str) -> None:
        response = self.harness.post("/rigs/demo/queue/actions", {"type": order})
        assert response.status_code in (200, 409, 503), response.text

    @invariant()
    def no_job_leaves_the_table(self) -> None:
        self.harness.until(self._settled)
        states_told(self.harness.told("state"))

    @invariant()
    def at_most_one_job_has_the_rig(self) -> None:
        self.harness.until(self._settled)
        queued = [state for state in self._states() if state == "queued"]
        alive = [state for state in self._states() if not STATES[state].terminal]
        assert len(alive) - len(queued) <= 1
        assert len(queued) == len(self.harness.manager.queue)

    def _states(self) -> list[JobState]:
        found = [self.harness.store.get(job) for job in self.jobs]
        return [row.state for row in found if row is not None]

    def _settled(self) -> bool:
        """Return whether nothing changes without an action."""
        live, bus = self.harness.manager.active, self.harness.bus
        if live is None:
            queue = self.harness.manager.queue
            return not len(queue) or bool(queue.halted)
        if live.status.terminal:
            return live.status.held
        quiet = {
            "ready": not live.request.autostart,
            "running": live.status.progress is not None
            and live.status.progress.seq == bus.place - 1
            and bus.place < len(bus.ticks),
            "pausing": not bus.rests,
            "paused": bus.paused,
            "awaiting_recovery": True,
            "aborting": bus.frozen,
        }
        return quiet.get(live.status.state, False)

    def teardown(self) -> None:
        try:
            self._every_stop_ends()
        finally:
            self.drawing.stop()
            self.harness.close()
            self.folder.cleanup()

    def _every_stop_ends(self) -> None:
        self.harness.until(self._settled)
        for job in reversed(self.jobs):
            if "stop" in self.harness.get(f"/jobs/{job}")["allowed_actions"]:
                self.harness.act(job, "stop")
            if self.harness.bus.frozen:
                self.harness.bus.thaw()
            state = self.harness.ended(job)["state"]
            assert STATES[state].terminal


def test_every_sequence_of_calls_follows_the_state_table() -> None:
    run_state_machine_as_test(
        Bench,
        settings=settings(
            max_examples=12,
            stateful_step_count=12,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
        ),
    )
