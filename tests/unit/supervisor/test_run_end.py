"""When a run is over: what was said of its last tick has come, or is not to be expected."""

from collections.abc import Callable
from dataclasses import replace

from pincette.config import RigFile
from pincette.messages import Applied, Telemetry
from pincette.topics import APPLIED

from .rig import Desk
from .samples import Tick


def test_a_last_word_that_comes_late_is_waited_for(desk: Desk) -> None:
    late: list[Telemetry] = []

    def overtaken(ticks: list[Tick]) -> list[Tick]:
        # Each program has a way of its own: the actuator's end is here before the outcome is.
        late.append(ticks[-1].telemetry)
        earlier = [replace(tick.telemetry, outcome="") for tick in ticks[:-1]]
        said = [*earlier, earlier[-1]]
        return [replace(tick, telemetry=view) for tick, view in zip(ticks, said, strict=True)]

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
