"""Comparison of a service's replayed outputs with the recorded ones, bit by bit."""

from collections import defaultdict, deque
from collections.abc import Iterable
from dataclasses import dataclass
from math import copysign
from typing import Any, cast

from pincette.core.messages import Applied, Message, Sample
from pincette.core.messages.arms import ARM_PREFIXES
from pincette.core.service import AnyService
from pincette.core.topics import TOPIC_OF

CLOCKED = ("command_age_s", "refused")
"""Fields that depend on the actuator's clock in real time."""


@dataclass(frozen=True, slots=True)
class Difference:
    """A field that differs from the record; an empty ``field`` means that a whole output was not
    repeated.
    """

    topic: str
    seq: int
    field: str
    recorded: Any
    replayed: Any


@dataclass(slots=True)
class Findings:
    """Results of one service."""

    service: str
    steps: int = 0
    identical: int = 0
    """Number of outputs that are bit-identical."""
    different: int = 0
    clocked: int = 0
    """Number of outputs that depend on the real-time clock only; they cannot be repeated."""
    first: Difference | None = None
    stopped: str = ""
    """Reason why the replay did not begin, or did not reach the end."""

    @property
    def same(self) -> bool:
        """Return whether everything was repeated bit-identically."""
        return not self.different and not self.stopped


class Comparison:
    """Recorded outputs of a service from seq 0 on, each until the replay repeats it."""

    def __init__(
        self,
        service: AnyService,
        messages: Iterable[Message],
        findings: Findings,
        *,
        lockstep: bool,
    ) -> None:
        self._findings, self._lockstep = findings, lockstep
        self._recorded: dict[tuple[type[Message], int], deque[Sample]] = defaultdict(deque)
        kinds = {topic.message for topic in service.outputs}
        for message in messages:
            if type(message) not in kinds or cast(Sample, message).seq < 0:
                continue
            if isinstance(message, Applied) and not (message.answered or lockstep):
                findings.clocked += 1
                continue
            sample = cast(Sample, message)
            self._recorded[type(sample), sample.seq].append(sample)

    def take(self, outputs: Iterable[Message]) -> None:
        """Compare a replayed output; outputs that are missing in the record are skipped."""
        for output in outputs:
            recorded = self._recorded.get((type(output), getattr(output, "seq", -1)))
            if recorded:
                self._compare(recorded.popleft(), cast(Sample, output))

    def end(self) -> None:
        """Count the outputs that were not repeated."""
        for samples in self._recorded.values():
            for sample in samples:
                self._differs(sample, "", "said", None)

    def _compare(self, recorded: Sample, replayed: Sample) -> None:
        clocked = CLOCKED if isinstance(recorded, Applied) and not self._lockstep else ()
        found, again = values_of(recorded), values_of(replayed)
        for name in [name for name in found | again if name not in clocked]:
            one, other = found.get(name), again.get(name)
            if not same(one, other):
                self._differs(recorded, name, one, other)
                return
        self._findings.identical += 1

    def _differs(self, sample: Sample, field: str, recorded: Any, replayed: Any) -> None:
        found = self._findings
        found.different += 1
        if found.first is None or sample.seq < found.first.seq:
            topic = TOPIC_OF[type(sample)].name
            found.first = Difference(topic, sample.seq, field, recorded, replayed)


def values_of(sample: Sample) -> dict[str, Any]:
    """Return the fields of a sample by name; those of its second arm have the prefix of tables."""
    values: dict[str, Any] = {}
    for name in sample.__struct_fields__:
        if name != "arms":
            values[name] = getattr(sample, name)
    arms: tuple[Any, ...] = getattr(sample, "arms", ())
    for prefix, arm in zip(ARM_PREFIXES, arms, strict=False):
        for name in arm.__struct_fields__:
            values[prefix + name] = getattr(arm, name)
    return values


def same(one: Any, other: Any) -> bool:
    """Return whether two values of a field are bit-identical; 0.0 and -0.0 are not."""
    if one != other:
        return False
    return not isinstance(one, float) or copysign(1.0, one) == copysign(1.0, other)
