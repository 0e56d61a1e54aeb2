"""Orders to a simulated rig, taken from the bus."""

from collections.abc import Callable
from typing import cast

from pincette.bus.protocol import Bus
from pincette.messages import Done, Message, Order
from pincette.sim.script.script import Script
from pincette.topics import ORDER, Question


def serve_orders(bus: Bus, script: Script) -> None:
    """Answer the question ``order``: each goes to the script, whose objection is the refusal."""

    def answer(
        _question: Question, request: Message, reply: Callable[[Message | str], None]
    ) -> None:
        reply(script.order(cast(Order, request)) or Done(0))

    bus.serve(ORDER, answer)
