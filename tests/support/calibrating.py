"""Calibrations played by the whole loop in one process, with a person at the bench."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any, cast

from pydantic import TypeAdapter

from pincette.api.calibrations import CalibrationResult
from pincette.api.requests import JobRequest
from pincette.config import RigFile
from pincette.core.faults import ActionCode
from pincette.core.messages import Action, Message, Sample, Telemetry
from pincette.core.topics import ACTION, TELEMETRY, Topic
from pincette.engine import simulated
from pincette.engine.composed import ComposedLoop
from pincette.sim.bench import Bench
from pincette_study.desk import REST_S, Desk
from pincette_supervisor.journal.store import JobRow
from pincette_supervisor.kinds.bodies import Body
from pincette_supervisor.planning.job_plans import plan_job
from pincette_supervisor.plugin import Planned
from pincette_supervisor.results.archive import Record, Take, gather

REQUEST: TypeAdapter[JobRequest] = TypeAdapter(Body)
HANDS_TICKS = 25
"""Number of ticks that a person takes to hang a weight."""


class Bystander:
    """A person at the bench, who hangs the requested weights and confirms."""

    def __init__(self, loop: ComposedLoop, bench: Bench, planned: Planned) -> None:
        self.loop, self.bench, self.planned = loop, bench, planned
        self.hung: list[float] = []
        self.waited = 0
        loop.bus.subscribe(TELEMETRY, self._look)

    def _look(self, _topic: Topic, message: Message) -> None:
        wait = self.planned.waits.get(cast(Telemetry, message).segment)
        if wait is None or not cast(Telemetry, message).playing:
            self.waited = 0
            return
        self.waited += 1
        if self.waited == HANDS_TICKS:
            weight_mN = wait.weight_mN
            assert weight_mN is not None
            assert f"{weight_mN:g}" in wait.instruction or "every weight" in wait.instruction
            self.hang(weight_mN)
            self.loop.bus.call(ACTION, Action(ActionCode.CONTINUE))

    def hang(self, weight_mN: float) -> None:
        self.bench.rig.hang(weight_mN)
        self.hung.append(weight_mN)


@contextmanager
def opened_benches() -> Generator[list[Bench]]:
    """Yield benches as they are opened, so that a person can act on them."""
    opened: list[Bench] = []
    opening: Callable[..., Bench] = simulated.open_bench

    def keep(*arguments: Any, **named: Any) -> Bench:
        opened.append(opening(*arguments, **named))
        return opened[-1]

    simulated.open_bench = keep
    try:
        yield opened
    finally:
        simulated.open_bench = opening


def after_strokes(rig: RigFile, rest_s: float = REST_S) -> ComposedLoop:
    """Return a rig whose arm has gone twice over the calibrated range, in epoch 1, and whose
    part is back."""
    desk = Desk(rig)
    desk.stroke(rest_s)
    return desk.loop


def calibrated(
    rig: RigFile,
    bench: list[Bench],
    calibration: str,
    fault: str = "",
    *,
    moved_before: bool = False,
    **wishes: Any,
) -> tuple[Record, Bystander]:
    """Play a calibration to its end; returns it as it would be stored, by a new arm or one that
    has moved."""
    body = {"kind": "calibrate", "calibration": calibration, **wishes}
    planned = plan_job(REQUEST.validate_python(body), rig)
    assert planned.plan.violations == []
    loop, epoch = (after_strokes(rig), 2) if moved_before else (ComposedLoop(rig), 1)
    person = Bystander(loop, bench[-1], planned)
    messages: list[Message] = [
        message
        for message in loop.play(planned.program, epoch)
        if not isinstance(message, Sample) or message.seq >= 0
    ]
    row = JobRow("job", "calibrate", rig.rig.name, "running", body, {}, "")
    record = gather(rig, row, planned, Take(epoch, messages))
    assert fault in record.fault
    assert bool(fault) == bool(record.fault)
    assert record.result.outcome == "moved"
    return record, person


def result_of(record: Record) -> CalibrationResult:
    assert isinstance(record.result, CalibrationResult)
    return record.result


def value(record: Record, quantity: str) -> Any:
    found = {item.quantity: item for item in result_of(record).values}
    return found[quantity].value
