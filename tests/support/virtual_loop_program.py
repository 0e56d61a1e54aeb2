"""One program of a virtual loop: a node and its turns, as ``ServiceLoop`` has them."""

from collections import deque
from collections.abc import Callable
from copy import copy, deepcopy
from dataclasses import dataclass
from typing import Any, Literal

from pincette.messages import Message
from pincette.runtime.node import Node
from pincette.runtime.turns import Turns

Reply = Callable[[Message | str], None]
Item = Message | tuple[Message, Reply]
Step = Literal["fire", "clock"]


@dataclass(slots=True)
class Program:
    """A node with its queue; what it does next is an event of the loop that names its ``turn``."""

    name: str
    node: Node
    turns: Turns
    queue: deque[Item]
    alive: bool = True
    busy: bool = False
    """In a step, or telling what came of it: what comes meanwhile waits in the queue."""
    turn: int = 0
    """Counts what the program does; an event of an older turn is void."""
    stopped_until_s: float = 0.0
    slow_s: float = 0.0
    """How much longer its next step takes."""
    step: Step = "fire"
    began_s: float = 0.0
    """The time that the step under way was given."""
    refused: int = 0
    """Payloads that were no message."""

    def forked(self, memo: dict[int, Any]) -> "Program":
        """Another program that goes on from here by itself; what never changes is shared."""
        twin = copy(self)
        twin.node = forked_node(self.node, memo)
        twin.turns = copy(self.turns)
        twin.turns.node = twin.node
        twin.turns.numbering = self.turns.numbering.copy()
        twin.turns.meter = None
        twin.queue = deque(self.queue)
        return twin


def forked_node(node: Node, memo: dict[int, Any]) -> Node:
    """Another node with the same state; its instrument is copied with the bench of ``memo``."""
    twin = copy(node)
    inner, own = vars(node), vars(twin)
    own["_pending"] = deque(inner["_pending"])
    own["_joins"] = inner["_joins"].copy()
    own["_notes"] = copy(inner["_notes"])
    own["_device"] = deepcopy(inner["_device"], memo)
    return twin
