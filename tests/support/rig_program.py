"""The rig program in a thread of a test, with a bus that receives nothing."""

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import cast

from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.core.messages import GroundTruth, Message
from pincette.engine.program import Context
from pincette.instruments.protocols import PositionSensor, VoltageOutput
from pincette_rig.program import run

START_S = 5.0


class DeafBus:
    """A bus that stores what is published."""

    def __init__(self) -> None:
        self.told: list[Message] = []
        self.names: list[str] = []
        self.closed = False

    def publish(self, message: Message) -> None:
        self.told.append(message)

    def serve(self, *_question: object) -> None:
        pass

    def announce(self, name: str) -> None:
        self.names.append(name)

    def close(self) -> None:
        self.closed = True


def context_of(rig: RigFile, bus: DeafBus, ready: Callable[[], object], folder: Path) -> Context:
    """Return the context that the program receives."""

    def join(rig: str | None = None, *, lockstep: bool | None = None) -> ZenohBus:
        assert (rig, lockstep) == (None, None)
        return cast(ZenohBus, bus)

    def say(_line: str) -> None:
        ready()

    return Context(rig, folder, join, say, threading.Event())


@contextmanager
def offered(rig: RigFile, folder: Path) -> Generator[DeafBus]:
    """Serve a rig's instruments for the duration of the block."""
    bus, ready = DeafBus(), threading.Event()

    context = context_of(rig, bus, ready.set, folder)
    thread = threading.Thread(target=run, args=(context,))
    thread.start()
    try:
        assert ready.wait(START_S)
        yield bus
    finally:
        context.stop.set()
        thread.join(START_S)
    assert not thread.is_alive()


def truths_of_three_writes(
    rig: RigFile,
    folder: Path,
    open_sensor: Callable[[], PositionSensor],
    open_output: Callable[[], VoltageOutput],
) -> list[GroundTruth]:
    """Write 1, 1 and 0.5 V, with a reading after each; returns the truth that the rig publishes."""
    with offered(rig, folder) as bus:
        sensor, output = open_sensor(), open_output()
        for voltage_V in (1.0, 1.0, 0.5):
            output.write_V(voltage_V)
            sensor.read_um()
        assert output.read_V() == 0.5
        sensor.close()
        output.close()
    return [message for message in bus.told if isinstance(message, GroundTruth)]
