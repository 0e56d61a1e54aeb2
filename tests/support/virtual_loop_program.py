"""One program of a virtual loop: a loop of one runner or several, and what waits for it."""

from collections import deque
from collections.abc import Callable
from copy import copy, deepcopy
from dataclasses import dataclass, field
from typing import Any

from pincette.bus.protocol import RequestHandler, Sink
from pincette.core.messages import Message
from pincette.core.topics import Request, Topic
from pincette.engine.loop import Loop
from pincette.engine.runner import Runner

Reply = Callable[[Message | str], None]
Item = Message | tuple[str, Message, Reply]
"""A sample; or a request to a service, with what takes the reply."""


class NoBus:
    """A bus that brings nothing: the virtual loop carries all messages itself."""

    def publish(self, message: Message) -> None:
        """Send nothing."""

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Bring nothing."""

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        """Bring no request."""

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        raise NotImplementedError((question, request, timeout_s))

    def close(self) -> None:
        """Nothing to leave."""


@dataclass(slots=True)
class Program:
    """A loop with its queue; what it does next is an event of the loop that names its
    ``turn``."""

    name: str
    loop: Loop
    queue: deque[Item] = field(default_factory=deque[Item])
    alive: bool = True
    busy: bool = False
    """In a step, or telling what came of it: what comes meanwhile waits in the queue."""
    turn: int = 0
    """Counts what the program does; an event of an older turn is void."""
    stopped_until_s: float = 0.0
    slow_s: float = 0.0
    """How much longer its next step takes,"""
    slow_service: str = ""
    """that of this service; of whichever comes next where none is named."""
    computed_s: float = 0.0
    """Of the step that is under way."""
    service: str = ""
    """Whose step is under way."""
    timed: bool = False
    """Whether a timer asked for it."""
    began_s: float = 0.0
    """The time that it was given."""
    refused: int = 0
    """Payloads that were no message."""

    @property
    def runner(self) -> Runner:
        """The runner whose step is under way."""
        return self.loop.runner(self.service)

    def runner_of(self, service: str) -> Runner:
        """Return the runner of a service; the only one where the program has another name."""
        runners = self.loop.runners
        return runners[0] if len(runners) == 1 else self.loop.runner(service)

    @property
    def boots_alike(self) -> bool:
        """Whether each of its kind begins as it did, since it has no instrument."""
        runners = self.loop.runners
        return len(runners) == 1 and runners[0].service.instrument is None

    def ready(self, now_s: float) -> Runner | None:
        """Return the first runner that messages have led to a step."""
        return next((runner for runner in self.loop.runners if runner.ready(now_s)), None)

    def due(self, now_s: float) -> Runner | None:
        """Return the first runner whose timer asks for a step."""
        return next((runner for runner in self.loop.runners if runner.due(now_s)), None)

    def kept_busy(self, now_s: float) -> tuple[Message, ...]:
        """Report to the actuator beside the step under way how long that took."""
        return self.loop.kept_busy(self.runner, now_s - self.began_s, self.computed_s, now_s)

    def forked(self, memo: dict[int, Any]) -> "Program":
        """Return a program that continues independently; what never changes is shared."""
        twin = copy(self)
        twin.loop = _forked_loop(self.loop, memo)
        twin.queue = deque(self.queue)
        return twin


def _forked_loop(loop: Loop, memo: dict[int, Any]) -> Loop:
    runners = {id(runner): forked_runner(runner, memo) for runner in loop.runners}
    twin = copy(loop)
    twin.runners = [runners[id(runner)] for runner in loop.runners]
    vars(twin)["_by_name"] = {runner.service.name: runner for runner in twin.runners}
    twin.looking = None if loop.looking is None else runners[id(loop.looking)]
    twin.takers = {
        kind: [runners[id(runner)] for runner in takers] for kind, takers in loop.takers.items()
    }
    return twin


def forked_runner(runner: Runner, memo: dict[int, Any]) -> Runner:
    """Return a runner with the same state; its instrument is copied with the bench of ``memo``."""
    twin = copy(runner)
    inner, own = vars(runner), vars(twin)
    twin.joiner = runner.joiner.copy()
    twin.stats = None
    own["_requests"] = copy(inner["_requests"])
    own["_device"] = deepcopy(inner["_device"], memo)
    return twin
