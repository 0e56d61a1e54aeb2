"""A grip right after a stop or a move: the arm is free of the part, or goes back first.

A stop during the approach once let the arm creep on to the part and press it while no job was
running; the next grip then started where no force could be zeroed.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.config.reading import laid_over
from pincette.core.faults import ActionCode
from pincette.core.messages import Action, GroundTruth, Message, Position, Reset, Telemetry
from pincette.core.topics import ACTION, GROUND_TRUTH, POSITION, RESET, Topic
from pincette.engine.arming import arm
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Present
from tests.support.grips import SHORT
from tests.support.rigs import demo_rig
from tests.support.virtual_rig import VirtualRig

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
LONGEST_TICKS = 2000
BEYOND_UM = 9.0
"""Position beyond the place of the part, which is removed, in µm."""


class Bench:
    """A virtual rig and the jobs that are played on it one after the other."""

    def __init__(self, rig: RigFile, data: Path) -> None:
        self.rig, self.virtual = rig, VirtualRig(rig, data)
        self.position: Position | None = None
        self.truth: list[GroundTruth] = []
        self.epoch = 0
        for topic in (POSITION, GROUND_TRUTH):
            self.virtual.bus.subscribe(topic, self._hear)
        self.tick(5)
        self.virtual.call(RESET, Reset(acknowledge=True))
        self.tick(5)

    def _hear(self, _topic: Topic, said: Message) -> None:
        if isinstance(said, Position):
            self.position = said
        elif isinstance(said, GroundTruth):
            self.truth.append(said)

    def tick(self, count: int = 1) -> None:
        for _ in range(count):
            self.virtual.tick()

    @property
    def x_um(self) -> float:
        assert self.position is not None
        return self.position.arms[0].x_um

    def play(
        self, request: dict[str, Any], stop: Callable[[Telemetry], bool] = lambda _: False
    ) -> tuple[str, list[str]]:
        """Play a job that is stopped once; returns its outcome and the planned phases."""
        known = self.position is not None  # an idle loop in lockstep publishes nothing before
        stands = Present(self.virtual.applied[-1].arms[0].voltage_V, self.x_um) if known else None
        planned = plan_job(REQUEST.validate_python(request), self.rig, stands)
        assert planned.plan.violations == []
        self.epoch += 1
        arm(self.virtual.bus, planned.program, epoch=self.epoch, digest=self.rig.digest())
        stopped = False
        for _ in range(LONGEST_TICKS):
            self.tick()
            reported = self.virtual.telemetry[-1:]
            if not reported or reported[0].epoch != self.epoch:
                continue
            if not stopped and stop(reported[0]):
                stopped = True
                self.virtual.call(ACTION, Action(ActionCode.STOP))
            if not reported[0].playing:
                return reported[0].outcome, [phase.phase for phase in planned.plan.phases]
        raise TimeoutError(f"{request} goes on")


def stopped_in(phase: str, tick: int) -> Callable[[Telemetry], bool]:
    """Stop from a tick of a phase on."""
    return lambda told: told.phase == phase and told.segment_tick >= tick


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(demo_rig(SHORT, time="lockstep"), tmp_path)


@pytest.mark.parametrize(
    ("phase", "tick"),
    [("approach", 2), ("approach", 10), ("contact", 5)],
)
def test_a_stop_before_contact_leaves_the_part_alone_and_the_next_grip_succeeds(
    bench: Bench, phase: str, tick: int
) -> None:
    part = bench.rig.part
    outcome, _ = bench.play({"kind": "grip"}, stopped_in(phase, tick))
    assert outcome == "stopped"
    assert bench.x_um < part.contact_um - part.contact_tolerance_um
    assert bench.truth[-1].arms[0].force_mN == 0.0
    outcome, phases = bench.play({"kind": "grip"})
    assert (outcome, phases[0]) == ("gripped", "zero")


def test_a_grip_after_a_move_beyond_the_part_goes_back_first(tmp_path: Path) -> None:
    scripted = laid_over(SHORT, {"simulation": {"scripts": True}})
    bench = Bench(demo_rig(scripted, time="lockstep"), tmp_path)
    bench.virtual.order("part", "remove", None, None)
    outcome, _ = bench.play({"kind": "move", "to_um": BEYOND_UM, "speed_um_per_s": 20.0})
    assert outcome == "moved"
    assert bench.x_um == pytest.approx(BEYOND_UM, abs=0.5)
    outcome, phases = bench.play({"kind": "grip"})
    assert (outcome, phases[:2]) == ("no_contact", ["open", "zero"])
    bench.virtual.order("part", "place", None, None)
    outcome, phases = bench.play({"kind": "grip"})
    assert (outcome, phases[0]) == ("gripped", "zero")
