"""The rig file over the bus, so that a supervisor needs nothing else to take up a rig."""

from collections.abc import Callable
from typing import cast

from pincette.bus.protocol import Bus
from pincette.config import ConfigError, RigFile, parse_told
from pincette.messages import Document, Message, RigFileRequest, RigFileTold
from pincette.topics import RIG_FILE, Question

ASK_S = 1.0


def serve_rig_file(bus: Bus, rig: RigFile, program: str) -> None:
    """Tell whoever asks which rig file a program of the loop works with."""
    told = RigFileTold(Document(rig.model_dump_json()), rig.digest())

    def answer(
        _question: Question, _request: Message, reply: Callable[[Message | str], None]
    ) -> None:
        reply(told)

    bus.serve(RIG_FILE[program], answer)


def ask_rig_file(bus: Bus, program: str) -> RigFileTold:
    """Ask a program of the loop for its rig file; raises BusError where it does not answer."""
    return cast(RigFileTold, bus.ask(RIG_FILE[program], RigFileRequest(), ASK_S))


def read_told(told: RigFileTold) -> RigFile:
    """The rig file that was told.

    Raises
    ------
    ConfigError
        Where this version of pincette does not read it as the program that works with it does.
    """
    rig = parse_told(told.text)
    if rig.digest() != told.digest:
        raise ConfigError(
            f"its digest is {rig.digest()} here and {told.digest} there: "
            "start all programs with the same version of pincette"
        )
    return rig
