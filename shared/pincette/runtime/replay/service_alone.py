"""One service of a recorded epoch, begun, asked and stepped as it was, and compared."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from pincette.config import RigFile
from pincette.messages import Asked, Load, Message, Reset, Sample
from pincette.runtime.carried import recalled
from pincette.runtime.node import Node
from pincette.runtime.replay.comparison import Comparison, Findings
from pincette.runtime.replay.steps import Gap, Samples, steps
from pincette.runtime.replay.tape import Tape
from pincette.service import AnyService
from pincette.topics import LOAD, LOOP, RESET, TOPIC_OF, TOPICS

RANK = {topic.name: LOOP.index(topic.producer) for topic in TOPICS if topic.producer in LOOP}
"""Order of the samples of one tick."""


class _StoppedError(Exception):
    """Nothing more can be repeated; the text says why."""


def replay(service: AnyService, rig: RigFile, messages: Sequence[Message]) -> Findings:
    """Repeat what a service did in an epoch.

    Of an actuator in real time that is what it made of the commands that it took: its clock is not
    recorded, and with it all that only time, or a question, led to.

    Parameters
    ----------
    rig
        As in the record, without a calibration.
    messages
        Of that epoch, in order of arrival.
    """
    findings = Findings(service.name)
    try:
        _play(service, rig, messages, findings)
    except _StoppedError as stop:
        findings.stopped = str(stop)
    return findings


def _play(
    service: AnyService, rig: RigFile, messages: Sequence[Message], findings: Findings
) -> None:
    asked = [item for item in messages if isinstance(item, Asked) and item.service == service.name]
    tape = Tape()
    node = _begun(service, rig, asked, tape)
    comparison = Comparison(service, messages, findings, lockstep=rig.lockstep)
    timeless = service.instrument is None or rig.lockstep
    waiting = deque([item for item in asked if _question(item) is not None] if timeless else [])
    for step in steps(service.name, Samples(messages, lockstep=rig.lockstep)):
        if isinstance(step, Gap):
            raise _StoppedError(f"{step.topic} {step.seq} is not in the record")
        place = _place(step.samples[-1])
        while waiting and (waiting[0].seq, RANK.get(waiting[0].topic, -1)) < place:
            _ask(node, waiting.popleft(), comparison)
        tape.fault = step.fault
        for sample in step.samples:
            node.accept(sample, 0.0)
        findings.steps += 1
        comparison.take(node.fire(0.0))
        tape.fault = ""
    for item in waiting:
        _ask(node, item, comparison)
    comparison.end()


def _begun(service: AnyService, rig: RigFile, asked: Sequence[Asked], tape: Tape) -> Node:
    """The service as the epoch found it."""
    armed = next((item for item in asked if item.arm is not None), None)
    if armed is None or armed.arm is None:
        raise _StoppedError("its arming is not in the record; older records do not hold it")
    node = Node(service, rig, tape, armed.arm.owner)
    # A newer version has another digest of the same rig file where it knows more quantities.
    arm = replace(armed.arm, digest=node.digest)
    before: list[Message] = [Reset(acknowledge=True)] if RESET in service.questions else []
    if LOAD in service.questions:
        before += _loaded(asked)
    for question in (*before, arm):
        reply, _ = node.ask(question, 0.0)
        if isinstance(reply, str):
            raise _StoppedError(f"it refuses to begin: {reply}")
    try:
        node.state = recalled(service, node.config, node.state, armed.carried)
    except (KeyError, TypeError, ValueError) as error:
        raise _StoppedError(f"what it carried into the epoch cannot be read: {error}") from error
    return node


def _loaded(asked: Sequence[Asked]) -> list[Load]:
    loads = [item.load for item in asked if item.load is not None]
    if not loads:
        raise _StoppedError("the program is not in the record")
    return loads


def _question(item: Asked) -> Message | None:
    """What was asked while the epoch went on."""
    return item.act or item.trip or item.reset


def _ask(node: Node, item: Asked, comparison: Comparison) -> None:
    reply, outputs = node.ask(cast(Message, _question(item)), 0.0)
    if isinstance(reply, str):
        raise _StoppedError(f"after sample {item.seq} it refuses what it took then: {reply}")
    comparison.take(outputs)


def _place(sample: Sample) -> tuple[int, int]:
    return sample.seq, RANK[TOPIC_OF[type(sample)].name]
