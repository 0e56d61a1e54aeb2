"""One service of a recorded epoch: armed, called and stepped as recorded, and its outputs
compared.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast, get_args

from msgspec.structs import replace

from pincette.config import RigFile
from pincette.core.faults import Fault, FaultCode
from pincette.core.messages import Load, Message, RequestLog, Reset, Sample
from pincette.core.service import AnyService
from pincette.core.topics import LOAD, LOOP, RESET, TOPIC_OF, TOPICS
from pincette.engine.replay.comparison import Comparison, Findings
from pincette.engine.replay.steps import Gap, Samples, Step, steps
from pincette.engine.request_log import restored
from pincette.engine.runner import Runner
from pincette.instruments.protocols import ErrorCode, InstrumentError

CAUSES: Mapping[FaultCode, ErrorCode] = {
    FaultCode(f"instrument_{cause}"): cause for cause in get_args(ErrorCode)
}
"""Error codes by the fault codes of an instrument."""


@dataclass(slots=True)
class Tape:
    """Simulated output that accepts any voltage, and fails whenever the recorded instrument
    failed.
    """

    fault: Fault | None = None
    found_V: float = 0.0
    """Voltage of the output at rest, in V; at the beginning of an epoch it comes from the
    record."""

    def write_V(self, voltage_V: float) -> None:  # noqa: ARG002  it goes nowhere
        """Accept a voltage without effect."""
        self.look()

    def read_V(self) -> float:
        """Return the voltage that was set in ``found_V``."""
        return self.found_V

    def write_parts(self, voltages_V: Sequence[float], interval_s: float) -> None:  # noqa: ARG002
        """Accept voltages without effect."""
        self.look()

    def begin_wave(self, voltages_V: Sequence[float], rate_hz: float) -> None:  # noqa: ARG002
        """Accept a wave without effect."""
        self.look()

    def look(self) -> None:
        """Raise the recorded failure, if there is one."""
        if self.fault is not None:
            raise InstrumentError(self.fault.words, CAUSES[self.fault.code])

    def close(self) -> None:
        """Do nothing, since there is no port."""


RANK = {topic.name: LOOP.index(topic.producer) for topic in TOPICS if topic.producer in LOOP}
"""Order of the samples of one tick."""


class _StoppedError(Exception):
    """Error if nothing more can be repeated; the text gives the reason."""


def replay(service: AnyService, rig: RigFile, messages: Sequence[Message]) -> Findings:
    """Repeat what a service did in the epoch of ``messages``; the rig is uncalibrated."""
    # In real time the clock of an actuator is not recorded: only its replies to commands are
    # repeated, not the effects of elapsed time or of a request.
    findings = Findings(service.name)
    try:
        _play(service, rig, messages, findings)
    except _StoppedError as stop:
        findings.stopped = str(stop)
    return findings


def _play(
    service: AnyService, rig: RigFile, messages: Sequence[Message], findings: Findings
) -> None:
    requests = [
        item for item in messages if isinstance(item, RequestLog) and item.service == service.name
    ]
    tapes = tuple(Tape() for _ in rig.arms)
    runner = _armed(service, rig, requests, tapes)
    comparison = Comparison(service, messages, findings, lockstep=rig.lockstep)
    timeless = service.instrument is None or rig.lockstep
    waiting = deque(
        [item for item in requests if _request_of(item) is not None] if timeless else []
    )
    for step in steps(service.name, Samples(messages, lockstep=rig.lockstep)):
        if isinstance(step, Gap):
            raise _StoppedError(f"{step.topic} {step.seq} is not in the record")
        place = _place(step.samples[-1])
        while waiting and (waiting[0].seq, RANK.get(waiting[0].topic, -1)) < place:
            _ask(runner, waiting.popleft(), comparison)
        failed = _tape_that_fails(tapes, step.fault)
        failed.fault = step.fault
        for sample in step.samples:
            runner.take(sample, 0.0)
        findings.steps += 1
        comparison.take(runner.fire(_now(runner, step)) or ())
        failed.fault = None
    for item in waiting:
        _ask(runner, item, comparison)
    comparison.end()


def _tape_that_fails(tapes: tuple[Tape, ...], failure: Fault | None) -> Tape:
    """Return the instrument of the arm that a fault names; on a rig with one arm, faults name
    none.
    """
    second = failure is not None and failure.number("arm") == 2
    return tapes[-1 if second else 0]


def _now(runner: Runner, step: Step) -> float:
    """Return a time at which the next command gets its recorded time for slewing.

    Without a recorded time the result is always the same.
    """
    moved_s: float = getattr(runner.state, "moved_s", 0.0)
    return moved_s + (step.slewing_s or 0.0)


def _armed(
    service: AnyService, rig: RigFile, requests: Sequence[RequestLog], tapes: tuple[Tape, ...]
) -> Runner:
    """Return the service in its state at the beginning of the epoch."""
    armed = next((item for item in requests if item.arm is not None), None)
    if armed is None or armed.arm is None:
        raise _StoppedError("its arming is not in the record, as in older records")
    runner = Runner(service, rig, tapes, armed.arm.owner, recorded=True)
    # A newer version has another digest of the same rig file if it knows more quantities.
    arm = replace(armed.arm, digest=runner.digest)
    before: list[Message] = [Reset(acknowledge=True)] if RESET in service.requests else []
    if LOAD in service.requests:
        before += _loaded(requests)
    for request in (*before, arm):
        reply, _ = runner.call(request, 0.0)
        if isinstance(reply, str):
            raise _StoppedError(f"it refuses to start: {reply}")
    try:
        runner.state = restored(service, runner.config, runner.state, armed.state_snapshot)
    except (KeyError, TypeError, ValueError) as error:
        raise _StoppedError(
            f"the state that it carried into the epoch cannot be read: {error}"
        ) from error
    if hasattr(runner.state, "moved_s"):
        runner.state = replace(runner.state, moved_s=0.0)
    return runner


def _loaded(requests: Sequence[RequestLog]) -> list[Load]:
    loads = [item.load for item in requests if item.load is not None]
    if not loads:
        raise _StoppedError("the motion program is not in the record")
    return loads


def _request_of(item: RequestLog) -> Message | None:
    """Return the requests during the epoch."""
    return item.action or item.trip or item.reset


def _ask(runner: Runner, item: RequestLog, comparison: Comparison) -> None:
    reply, outputs = runner.call(cast(Message, _request_of(item)), 0.0)
    if isinstance(reply, str):
        raise _StoppedError(
            f"after sample {item.seq} it refuses a request that it accepted in the "
            f"recorded run: {reply}"
        )
    comparison.take(outputs)


def _place(sample: Sample) -> tuple[int, int]:
    return sample.seq, RANK[TOPIC_OF[type(sample)].name]
