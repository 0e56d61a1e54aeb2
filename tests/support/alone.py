"""One service of a recorded run: a tape replaces its instrument, and the record its inputs."""

from collections.abc import Sequence

from pincette.config import RigFile
from pincette.control.planning.program import Program
from pincette.core.messages import Arm, GroundTruth, Load, Message, Position, Reset
from pincette.core.service import AnyService
from pincette.core.topics import LOAD, RESET
from pincette.engine.composed import ComposedLoop
from pincette.engine.runner import Runner

EPOCH = 1


def recording(rig: RigFile, program: Program) -> tuple[Message, ...]:
    """Return every message of a completely played program, in order, without the truth of the
    simulation."""
    published = ComposedLoop(rig).play(program, EPOCH)
    return tuple(message for message in published if not isinstance(message, GroundTruth))


class Tape:
    """Both instruments at once: positions as recorded, voltages are discarded."""

    def __init__(self, rig: RigFile, messages: Sequence[Message]) -> None:
        offset_um = rig.sensor.offset_um
        self._positions_um = iter(
            [
                message.arms[0].x_um + offset_um
                for message in messages
                if isinstance(message, Position)
            ]
        )

    def read_um(self) -> float:
        """Return the next position of the recording."""
        return next(self._positions_um)

    def read_V(self) -> float:
        """Return the voltage at the start of the recording."""
        return 0.0

    def write_V(self, voltage_V: float) -> None:
        """Accept any voltage."""

    def write_parts(self, voltages_V: Sequence[float], interval_s: float) -> None:
        """Accept any voltages."""

    def close(self) -> None:
        """Do nothing: there is no port to close."""


def service_alone(
    service: AnyService, rig: RigFile, program: Program, messages: Sequence[Message]
) -> tuple[Runner, list[Message]]:
    """Return a service that is ready for the first sample, and its messages until then."""
    runner = Runner(service, rig, Tape(rig, messages) if service.instrument else None)
    published: list[Message] = []
    questions: list[Message] = [Arm(EPOCH, 1, rig.digest())]
    if LOAD in service.requests:
        questions.insert(0, Load(program))
    if RESET in service.requests:
        questions.insert(0, Reset(acknowledge=True))
    for question in questions:
        reply, outputs = runner.call(question, 0.0)
        if isinstance(reply, str):
            raise TypeError(f"{service.name} refuses {type(question).__name__}: {reply}")
        published += outputs
    return runner, published
