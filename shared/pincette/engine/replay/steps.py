"""Steps that a service made and the samples that it used, as far as a record shows them; pure
functions.

In real time a sample may be skipped, and a partner may come too late. The outputs show it: a
degraded estimate had no partner, and a sample without an output caused no step.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar, cast

from pincette.core.faults import TRIPPED, Cause, Fault
from pincette.core.messages import Applied, Command, Estimate, Message, Position, Sample, Telemetry
from pincette.core.topics import TOPIC_OF

S = TypeVar("S", bound=Sample)


@dataclass(frozen=True, slots=True)
class Step:
    """The samples of one step, the trigger last, and the instrument's reply to its output."""

    samples: tuple[Sample, ...]
    fault: Fault | None = None
    slewing_s: float | None = None
    """Time since the last change of the output, used for the slew limit of an actuator's command in
    real time; None if it is not recorded.
    """


@dataclass(frozen=True, slots=True)
class Gap:
    """A sample that a step used and that is missing in the record: nothing after it can be
    repeated.
    """

    topic: str
    seq: int


class Samples:
    """The samples of one epoch, by type and number."""

    def __init__(self, messages: Iterable[Message], *, lockstep: bool) -> None:
        self.lockstep = lockstep
        self._by_kind: dict[type[Message], dict[int, list[Sample]]] = {}
        for message in messages:
            if isinstance(message, Sample):
                by_seq = self._by_kind.setdefault(type(message), {})
                by_seq.setdefault(message.seq, []).append(message)

    def seqs(self, *kinds: type[Sample]) -> list[int]:
        """Return the numbers from 0 on for which there is a sample of one of these types."""
        found = {seq for kind in kinds for seq in self._by_kind.get(kind, {}) if seq >= 0}
        return sorted(found)

    def all(self, kind: type[S], seq: int) -> list[S]:
        """Return every sample of a type and number, in order of arrival."""
        return cast("list[S]", self._by_kind.get(kind, {}).get(seq, []))

    def first_unknown(self, after: int, before: int) -> int | None:
        """Return the first missing number between two present ones; a sensor leaves none out."""
        known = (self._by_kind.get(Position, {}), self._by_kind.get(Estimate, {}))
        between = range(after + 1, before)
        return next((seq for seq in between if not any(seq in kind for kind in known)), None)

    def newest(self, kind: type[S], seq: int) -> S | None:
        """Return the last sample; None if there is none."""
        found = self.all(kind, seq)
        return found[-1] if found else None


def steps(service: str, samples: Samples) -> Iterator[Step | Gap]:
    """Return the steps of a service in order, up to the first gap; a sensor has none."""
    last = -1
    for step in STEPS[service](samples):
        seq = step.seq if isinstance(step, Gap) else step.samples[-1].seq
        unknown = samples.first_unknown(last, seq)
        if unknown is not None:
            yield _gap(Position, unknown)
            return
        last = seq
        yield step


def estimator_steps(samples: Samples) -> Iterator[Step | Gap]:
    """Return a step for each estimate, including estimates that only their commands show."""
    for seq in samples.seqs(Estimate, Command):
        position = samples.newest(Position, seq)
        if position is None:
            yield _gap(Position, seq)
            return
        estimate = samples.newest(Estimate, seq)
        if estimate is not None and estimate.degraded:
            yield Step((position,))
            continue
        found = samples.all(Applied, seq - 1)
        applied = [item for item in found if estimate is None or _joined(estimate, item)]
        if not applied:
            yield _gap(Applied, seq - 1)
            return
        yield Step((applied[-1], position))


def _joined(estimate: Estimate, applied: Applied) -> bool:
    """Return whether ``applied`` may have led to an estimate.

    A tick may have several ``applied``.
    """
    return (
        estimate.arms[0].applied_V == applied.arms[0].voltage_V
        and estimate.arms[0].limits_active == applied.arms[0].limits_active
        and estimate.tripped == (applied.state in TRIPPED)
    )


def controller_steps(samples: Samples) -> Iterator[Step | Gap]:
    """Return a step for each command."""
    for seq in samples.seqs(Command, Telemetry):
        estimate = samples.newest(Estimate, seq)
        if estimate is None:
            yield _gap(Estimate, seq)
            return
        yield Step((estimate,))


def actuator_steps(samples: Samples) -> Iterator[Step | Gap]:
    """Return all steps in lockstep.

    In real time it returns only steps with an accepted command, since no clock is recorded.
    """
    last = max(samples.seqs(Applied), default=-1)
    for seq in samples.seqs(Position, Command):
        answers = samples.all(Applied, seq)
        command = samples.newest(Command, seq)
        taken = seq <= last if samples.lockstep else any(item.answered for item in answers)
        if not taken:
            continue
        position = samples.newest(Position, seq)
        for kind, sample in ((Position, position), (Command, command)):
            if sample is None:
                yield _gap(kind, seq)
                return
            if kind is Position:
                yield Step((sample,))
                continue
            given_s = next((item.slewing_s for item in answers if item.answered), None)
            yield Step((sample,), _fault(answers), given_s)


def _fault(answers: list[Applied]) -> Fault | None:
    return next((item.faults[0] for item in answers if item.cause == Cause.DEVICE), None)


def _gap(kind: type[Sample], seq: int) -> Gap:
    return Gap(TOPIC_OF[kind].name, seq)


STEPS: Mapping[str, Callable[[Samples], Iterator[Step | Gap]]] = {
    "estimator": estimator_steps,
    "controller": controller_steps,
    "actuator": actuator_steps,
}
"""Function for each service that returns its steps."""
