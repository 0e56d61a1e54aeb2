"""The rig file over the bus, so that a supervisor needs nothing else to take up a rig."""

from collections.abc import Callable
from typing import cast

from pincette.bus.protocol import Bus
from pincette.config import ConfigError, RigFile, parse_rig_json
from pincette.control.quantities import Document
from pincette.core.messages import Message, RigFileReply, RigFileRequest
from pincette.core.topics import RIG_FILE, Request

ASK_S = 1.0


def serve_rig_file(bus: Bus, rig: RigFile, program: str) -> None:
    """Answer requests for the rig file that a program of the loop works with."""
    rig_reply = RigFileReply(Document(rig.model_dump_json()), rig.digest())

    def answer(
        _request: Request, _message: Message, reply: Callable[[Message | str], None]
    ) -> None:
        reply(rig_reply)

    bus.serve(RIG_FILE[program], answer)


def ask_rig_file(bus: Bus, program: str) -> RigFileReply:
    """Ask a program of the loop for its rig file; raises BusError where it does not answer."""
    return cast(RigFileReply, bus.call(RIG_FILE[program], RigFileRequest(), ASK_S))


def read_rig_reply(reply: RigFileReply) -> RigFile:
    """The rig file of a reply; raises ConfigError."""
    rig = parse_rig_json(reply.text)
    if rig.digest() != reply.digest:
        raise ConfigError(
            f"its digest is {rig.digest()} here and {reply.digest} there: "
            "start all programs with the same version of pincette"
        )
    return rig
