"""End of a run: all messages of its last tick have arrived, or are no longer expected."""

from collections.abc import Callable

import pytest

from pincette.config import RigFile
from pincette.control.record import replace
from pincette.core.faults import Outcome
from pincette.core.messages import Message, Telemetry
from pincette.core.topics import TELEMETRY, Topic

from .harness import Harness
from .samples import Tick


def untold(ticks: list[Tick]) -> list[Tick]:
    """Ticks whose end is not reported."""
    earlier = [replace(tick.telemetry, outcome=Outcome.NONE) for tick in ticks[:-1]]
    stated = [*earlier, earlier[-1]]
    return [replace(tick, telemetry=view) for tick, view in zip(ticks, stated, strict=True)]


def test_a_late_last_message_is_awaited(harness: Harness) -> None:
    late: list[Telemetry] = []

    def overtaken(ticks: list[Tick]) -> list[Tick]:
        # Each program has its own channel: the actuator's end arrives before the outcome.
        late.append(ticks[-1].telemetry)
        return untold(ticks)

    harness.bus.edit = overtaken
    job = harness.grip()["id"]
    live = harness.live
    harness.until(lambda: (now := live.status.progress) is not None and now.seq == late[0].seq)
    harness.bus.publish(late[0])
    assert harness.ended(job)["state"] == "succeeded"


def test_the_outcome_is_queried_if_its_message_was_lost(
    rig_file: RigFile, open_harness: Callable[..., Harness], monkeypatch: pytest.MonkeyPatch
) -> None:
    harness = open_harness(rig_file, guard_s=0.3)
    lost: list[Telemetry] = []

    def deaf(ticks: list[Tick]) -> list[Tick]:
        lost.append(ticks[-1].telemetry)
        return untold(ticks)

    def last_word(topic: Topic, timeout_s: float = 1.0) -> Message | None:
        return lost[0] if topic is TELEMETRY else heard(topic, timeout_s)

    heard = harness.bus.latest
    harness.bus.edit = deaf
    monkeypatch.setattr(harness.bus, "latest", last_word)
    ended = harness.ended(harness.grip()["id"])
    assert ended["state"] == "succeeded", ended["cause"]
