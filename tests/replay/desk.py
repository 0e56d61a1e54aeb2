"""A rig in one process that plays several jobs, each recorded as by the recorder."""

from collections.abc import Callable
from pathlib import Path

from pincette.config import RigFile
from pincette.control.planning.program import Program
from pincette.core.faults import ActionCode, Cause
from pincette.core.messages import (
    Action,
    Applied,
    Message,
    RequestLog,
    Reset,
    Sample,
    Telemetry,
    Trip,
)
from pincette.core.topics import ACTION, RESET, TOPICS, TRIP, Topic
from pincette.engine.arming import arm
from pincette.engine.composed import ComposedLoop
from pincette.records.mcap_file import McapFile
from pincette.records.mcap_reading import Recording, read

START_NS = 1_763_740_800_000_000_000
Watch = Callable[["Desk", Telemetry | Applied], None]


class Desk:
    """A rig, and a person who acts on its messages."""

    def __init__(self, rig: RigFile) -> None:
        self.rig = rig
        self.loop = ComposedLoop(rig)
        self.voltage_V = self.x_um = 0.0
        self.held = False
        self._said: list[Message] = []
        self._watch: Watch = nobody
        for topic in TOPICS:
            self.loop.bus.subscribe(topic, self._take)
        self.reset()

    def _take(self, _topic: Topic, message: Message) -> None:
        self._said.append(message)
        if isinstance(message, Applied):
            self.voltage_V, self.held = message.arms[0].voltage_V, message.part_held
        if isinstance(message, Telemetry | Applied):
            self._watch(self, message)

    def play(
        self, program: Program, epoch: int, watch: "Watch | None" = None, calibration: str = ""
    ) -> list[Message]:
        """Arm, run to the end, and return the messages of that epoch."""
        self._watch = watch or nobody
        self._said.clear()
        digest = self.rig.digest()
        arm(self.loop.bus, program, epoch=epoch, digest=digest, calibration=calibration)
        while self.loop.bus.pump():
            pass
        selected = [item for item in self._said if isinstance(item, Sample | RequestLog)]
        return [item for item in selected if item.epoch == epoch]

    def act(self, action: str) -> None:
        """Request an action of the controller."""
        self.loop.bus.call(ACTION, Action(ActionCode(action)))

    def trip(self) -> None:
        """Request the safe state from the actuator."""
        self.loop.bus.call(TRIP, Trip(Cause.ESTOP))

    def reset(self) -> None:
        """Clear the latch."""
        self.loop.bus.call(RESET, Reset(acknowledge=True))


def nobody(_desk: Desk, _message: Telemetry | Applied) -> None:
    """Do nothing."""


def at(phase: str, tick: int, do: Callable[[Desk], None]) -> Watch:
    """Act at a tick of a phase, in any segment."""

    def watch(desk: Desk, message: Telemetry | Applied) -> None:
        if isinstance(message, Telemetry) and message.playing:
            here = message.phase, message.segment_tick
            if here == (phase, tick):
                do(desk)

    return watch


def recorded(folder: Path, rig: RigFile, messages: list[Message], epoch: int) -> Recording:
    """Return the messages as they are read from a record, with the rig file."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "job.mcap"
    period_s = rig.rig.period_s
    about = {"job": folder.name, "epoch": str(epoch), "period_s": repr(period_s)}
    file = McapFile(path, rig.rig.name, about=about, start_ns=START_NS, period_s=period_s)
    file.attach("rig.json", "application/json", rig.model_dump_json().encode(), START_NS)
    for place, message in enumerate(messages):
        file.add(message, START_NS + place)
    file.finish({"complete": "true", "detail": "", "dropped": "0", "messages": str(len(messages))})
    return read(path)
