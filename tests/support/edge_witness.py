"""Who listens at a rig's own router: ``python -m tests.support.edge_witness RIG``.

Each change of what the actuator says, and each action of the controller, is a line of JSON on
standard output, with the monotonic time of its arrival. It ends with standard input.
"""

import json
import sys
from pathlib import Path
from time import monotonic

from pincette.bus.endpoints import tool_endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli import opened
from pincette.core.messages import Applied, Message, Telemetry
from pincette.core.topics import APPLIED, TELEMETRY, Topic


def main() -> None:
    """Listen until nobody wants to know any more."""
    file = opened(Path(sys.argv[1]))
    beside = file.bus.model_copy(update={"served_at": "rig"})
    rig = file.model_copy(update={"bus": beside})
    before: list[object] = [None]

    def say(**what: object) -> None:
        print(json.dumps({"at_s": monotonic(), **what}), flush=True)

    def take(_topic: Topic, message: Message) -> None:
        if isinstance(message, Applied):
            now = message.state, message.cause, message.part_held
            if now != before[0]:
                before[0] = now
                say(
                    state=now[0],
                    cause=now[1],
                    part_held=now[2],
                    voltage_V=message.arms[0].voltage_V,
                )
        elif isinstance(message, Telemetry) and message.acted:
            say(acted=" ".join(message.acted), phase=message.phase)

    bus = ZenohBus(tool_endpoint(rig), rig.rig.name, "witness")
    bus.subscribe(APPLIED, take)
    bus.subscribe(TELEMETRY, take)
    say(begun=True)
    sys.stdin.read()
    bus.close()


if __name__ == "__main__":
    main()
