"""Distinguishes the publisher of a topic from other programs by the session in each sample."""

from collections.abc import Callable
from time import monotonic

import zenoh

from pincette.core.topics import COMMAND, LOOP, Topic

SILENT_S = 0.5
"""Time in s for which a program must be silent before another one may publish its topic; a restart
takes longer.
"""


class Producer:
    """The session whose samples of one topic are accepted.

    Programs state their session with every sample. The first received session owns the topic until
    it is silent. A program that states the session of another program cannot be distinguished from
    that program.
    """

    __slots__ = ("_clock", "_name", "_received_at_s", "_session")

    _session: zenoh.ZenohId

    def __init__(self, name: str, clock: Callable[[], float] = monotonic) -> None:
        """``name``: name of the program that publishes the topic."""
        self._name, self._clock = name, clock
        self._received_at_s = float("-inf")
        """Time of the newest accepted sample, in s."""

    def refusal(self, source: zenoh.SourceInfo | None) -> str:
        """Return why a sample is rejected; empty if it is accepted."""
        if source is None:
            return f"the sample states no session, so it is not from the {self._name}"
        session, now_s = source.source_id.zid, self._clock()
        if now_s - self._received_at_s <= SILENT_S and session != self._session:
            return f"the sample is from the session {session}, not from the {self._name}"
        self._session, self._received_at_s = session, now_s
        return ""


def producer_of(topic: Topic) -> Producer | None:
    """Return the program whose samples of a topic are accepted; None if samples of every program
    are accepted.

    Commands state an owner, which the actuator uses to detect a second controller.
    """
    checked = topic.producer in LOOP and topic is not COMMAND
    return Producer(topic.producer) if checked else None
