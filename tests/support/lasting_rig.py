"""A simulated rig in use: its arm lives on, while programs and supervisors end and start again.

Jobs go through the supervisor's job manager, journal and records, as requests over REST do. Only
time is virtual.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import Any
from unittest.mock import patch

from pydantic import TypeAdapter

from pincette.api.jobs import Job
from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.core.messages import Estimate, GroundTruth, Message, Telemetry
from pincette.core.topics import ESTIMATE, TELEMETRY, Topic
from pincette.engine import composed
from pincette.engine.runner import Runner
from pincette.sim.bench import open_bench
from pincette_supervisor.kinds.bodies import Body
from tests.support.office import Office
from tests.support.virtual_rig import VirtualRig

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
LONGEST_TICKS = 6000
COMPUTES_S = 300.0
"""Longest wall-clock time that a job's thread computes on a loaded machine."""
SETTLE_TICKS = 50
INSTANCES = 100
"""Numbers of instances between two starts, for programs that are replaced alone."""


class LastingRig:
    """An arm with its instruments, and the programs that run beside it."""

    def __init__(self, rig: RigFile, data: Path) -> None:
        self.data = data
        self.truth: GroundTruth | None = None
        self.estimate: Estimate | None = None
        """Newest estimate, until its tick has ended."""
        self.view: Telemetry | None = None
        self.compared: list[tuple[Estimate, GroundTruth]] = []
        """Estimates since the newest job began, each with what was true at its sample."""
        self.peak_mN = 0.0
        """Largest true force since the newest job began."""
        self.bench = open_bench(rig, lambda: 0.0, self._tell)
        self._starts = 0
        self.start(rig)

    def start(self, rig: RigFile) -> None:
        """Start all programs, with a rig file."""
        self.rig = rig
        self._starts += 1
        self._runners: dict[str, tuple[Runner, tuple[Any, ...], dict[str, Any]]] = {}
        with patch.object(composed, "Runner", self._runner):
            self.virtual = VirtualRig(rig, self.data, self.bench)
        for topic in (ESTIMATE, TELEMETRY):
            self.virtual.bus.subscribe(topic, self._hear)
        self.office = Office(self.virtual, self.data)
        self.office.steps.guard_s = COMPUTES_S
        self.office.health.reset()

    def end(self) -> None:
        """End the supervisor and all programs."""
        self.office.end()
        self.virtual.close()

    def restart(self, rig: RigFile | None = None) -> None:
        """End all programs and start them again, with another rig file where one is given."""
        self.end()
        self.start(rig or self.rig)

    def restart_program(self, name: str) -> None:
        """Replace one program by a new one, as after its end."""
        runner, args, named = self._runners[name]
        runner.__init__(*args, **{**named, "instance": runner.instance + 1})  # type: ignore[misc]

    def _runner(self, *args: Any, **named: Any) -> Runner:
        named = {"instance": self._starts * INSTANCES, **named}
        runner = Runner(*args, **named)
        self._runners[runner.service.name] = runner, args, named
        return runner

    def _tell(self, truth: GroundTruth) -> None:
        self.truth = truth
        self.peak_mN = max(self.peak_mN, truth.arms[0].force_mN)
        if self.estimate is not None:
            self.compared.append((self.estimate, self.truth))
            self.estimate = None

    def _hear(self, _topic: Topic, message: Message) -> None:
        if isinstance(message, Estimate):
            self.estimate = message
        elif isinstance(message, Telemetry):
            self.view = message

    def create(self, **body: Any) -> str:
        """Create a job that starts at once; raises ProblemError where it is refused."""
        request = REQUEST.validate_python({"autostart": True, **body})
        self.peak_mN = 0.0
        self.compared.clear()
        self.view = None
        return self.office.manager.create(request, predict=False)[0].id

    def job(self, name: str) -> Job:
        """Return a job as it is now."""
        self.office.manager.context.write_queue.flush()
        return self.office.manager.index.job(name)

    def until(self, reached: Callable[[], bool], ticks: int = LONGEST_TICKS) -> None:
        """Let time pass until a condition holds; raises TimeoutError."""
        for _ in range(ticks):
            if reached():
                return
            self.office.steps.pass_()
        raise TimeoutError(f"not reached after {ticks} ticks: {self.view}")

    def ended(self, name: str) -> Job:
        """Let a job come to its end and its record be complete."""
        self.until(lambda: self.office.manager.index.is_recorded(name))
        assert not self.office.faults, self.office.faults
        return self.job(name)

    def run(self, **body: Any) -> Job:
        """Run one job to its end."""
        return self.ended(self.create(**body))

    def hold(self, phase: str = "hold", tick: int = 20, **body: Any) -> str:
        """Begin a job and return it once a tick of a phase is reached."""
        name = self.create(**body)
        self.until(
            lambda: (
                self.view is not None
                and self.view.phase == phase
                and self.view.segment_tick >= tick
            )
        )
        return name

    def settle(self, ticks: int = SETTLE_TICKS) -> None:
        """Let some time pass."""
        self.office.steps.pass_(ticks)

    def beyond_mN(self) -> float:
        """Return by how much a stated force was off beyond its uncertainty, at the most.

        Forces are stated where they have a zero. It is negative where all were within U.
        """
        found = [
            abs(said.arms[0].force_mN - truth.arms[0].force_mN) - said.arms[0].force_uncertainty_mN
            for said, truth in self.compared
            if said.valid and said.arms[0].zero_age_s is not None
        ]
        return max(found, default=-inf)

    @property
    def true_mN(self) -> float:
        """True force at the newest sample."""
        assert self.truth is not None
        return self.truth.arms[0].force_mN


def outcome(job: Job) -> str:
    """Return the outcome of a job; its state where it has no result."""
    return str((job.result or {}).get("outcome", job.state))


@contextmanager
def lasting_rig(rig: RigFile, data: Path) -> Generator[LastingRig]:
    """Open a rig with its programs, and end them."""
    opened = LastingRig(rig, data)
    try:
        yield opened
    finally:
        opened.end()
