"""When a run is over: what was said of its last tick has come, or is not to be expected."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from pincette.config import RigFile
from pincette.messages import Applied, Message, Telemetry
from pincette.topics import APPLIED, TELEMETRY, Topic

from .rig import Desk
from .samples import Tick


def untold(ticks: list[Tick]) -> list[Tick]:
    """Ticks of which none tells how it ended."""
    earlier = [replace(tick.telemetry, outcome="") for tick in ticks[:-1]]
    said = [*earlier, earlier[-1]]
    return [replace(tick, telemetry=view) for tick, view in zip(ticks, said, strict=True)]


def test_a_last_word_that_comes_late_is_waited_for(desk: Desk) -> None:
    late: list[Telemetry] = []

    def overtaken(ticks: list[Tick]) -> list[Tick]:
        # Each program has a way of its own: the actuator's end is here before the outcome is.
        late.append(ticks[-1].telemetry)
        return untold(ticks)

    desk.bus.edit = overtaken
    job = desk.grip()["id"]
    live = desk.conductor.active
    assert live is not None
    desk.until(lambda: live.progress is not None and live.progress.seq == late[0].seq)
    desk.bus.publish(late[0])
    assert desk.ended(job)["state"] == "succeeded"


def test_a_last_word_that_is_lost_is_not_waited_for_while_the_loop_idles(
    rig_file: RigFile, open_desk: Callable[..., Desk]
) -> None:
    desk = open_desk(rig_file, guard_s=0.3)
    desk.bus.edit = lambda ticks: [
        *ticks[:-1],
        replace(ticks[-1], telemetry=ticks[-2].telemetry),
    ]
    job = desk.grip()["id"]
    live = desk.conductor.active
    assert live is not None

    def over() -> bool:
        said = desk.bus.latest(APPLIED)
        if isinstance(said, Applied):
            desk.bus.publish(replace(said, seq=said.seq + 1))
        return live.terminal

    desk.until(over)
    assert desk.ended(job)["state"] == "succeeded"


def test_how_it_ended_is_asked_for_where_the_word_of_it_was_lost(
    rig_file: RigFile, open_desk: Callable[..., Desk], monkeypatch: pytest.MonkeyPatch
) -> None:
    desk = open_desk(rig_file, guard_s=0.3)
    lost: list[Telemetry] = []

    def deaf(ticks: list[Tick]) -> list[Tick]:
        lost.append(ticks[-1].telemetry)
        return untold(ticks)

    def last_word(topic: Topic, timeout_s: float = 1.0) -> Message | None:
        return lost[0] if topic is TELEMETRY else heard(topic, timeout_s)

    heard = desk.bus.latest
    desk.bus.edit = deaf
    monkeypatch.setattr(desk.bus, "latest", last_word)
    ended = desk.ended(desk.grip()["id"])
    assert ended["state"] == "succeeded", ended["cause"]
