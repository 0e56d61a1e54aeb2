"""A simulated rig in use: its arm keeps its state, while programs and supervisors end and restart.

Jobs go through the supervisor's job manager, journal and records, as requests over REST do. Only
time is virtual.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from pydantic import TypeAdapter

from pincette.api.jobs import Job
from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.core.messages import GroundTruth, Message, Telemetry
from pincette.core.topics import TELEMETRY, Topic
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


class LastingRig:
    """An arm with its instruments, and the programs that are connected to it."""

    def __init__(self, rig: RigFile, data: Path) -> None:
        self.data = data
        self.truth: GroundTruth | None = None
        self.view: Telemetry | None = None
        self.peak_mN = 0.0
        """Largest true force since the start of the newest job."""
        self.bench = open_bench(rig, lambda: 0.0, self._tell)
        self._starts = 0
        self.start(rig)

    def start(self, rig: RigFile) -> None:
        """Start all programs, with a rig file."""
        self.rig = rig
        self._starts += 1
        with patch.object(composed, "Runner", self._runner):
            self.virtual = VirtualRig(rig, self.data, self.bench)
        self.virtual.bus.subscribe(TELEMETRY, self._hear)
        self.office = Office(self.virtual, self.data)
        self.office.steps.guard_s = COMPUTES_S
        self.office.health.reset()

    def end(self) -> None:
        """End the supervisor and all programs."""
        self.office.end()
        self.virtual.close()

    def restart(self, rig: RigFile | None = None) -> None:
        """End all programs and start them again, with another rig file if one is given."""
        self.end()
        self.start(rig or self.rig)

    def _runner(self, *args: Any, **named: Any) -> Runner:
        return Runner(*args, **{"instance": self._starts, **named})

    def _tell(self, truth: GroundTruth) -> None:
        self.truth = truth
        self.peak_mN = max(self.peak_mN, truth.arms[0].force_mN)

    def _hear(self, _topic: Topic, message: Message) -> None:
        if isinstance(message, Telemetry):
            self.view = message

    def create(self, **body: Any) -> str:
        """Create a job that starts at once; raises ProblemError if it is refused."""
        request = REQUEST.validate_python({"autostart": True, **body})
        self.peak_mN = 0.0
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
        """Wait until a job has ended and its record is complete."""
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

    @property
    def true_mN(self) -> float:
        """Return the outcome of a job; its state if it has no result."""
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
