"""The rig file over the bus: a supervisor needs no other source to serve a rig."""

from collections.abc import Callable

from pincette.bus.protocol import Bus
from pincette.config import ConfigError, RigFile, parse_rig_json
from pincette.control.quantities import Document
from pincette.core.messages import Message, RigFileReply
from pincette.core.topics import RIG_FILE, Request


def serve_rig_file(bus: Bus, rig: RigFile, program: str) -> None:
    """Reply to requests for the rig file that a program of the loop uses."""
    rig_reply = RigFileReply(Document(rig.model_dump_json()), rig.digest())

    def answer(
        _request: Request, _message: Message, reply: Callable[[Message | str], None]
    ) -> None:
        reply(rig_reply)

    bus.serve(RIG_FILE[program], answer)


def read_rig_reply(reply: RigFileReply) -> RigFile:
    """Return the rig file of a reply; raises ConfigError."""
    rig = parse_rig_json(reply.text)
    if rig.digest() != reply.digest:
        raise ConfigError(
            f"its digest is {rig.digest()} here and {reply.digest} there: "
            "start all programs with the same version of pincette"
        )
    return rig
