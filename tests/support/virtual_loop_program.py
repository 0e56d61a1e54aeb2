"""One program of a virtual loop: a loop of one runner or several, and its queue."""

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
"""A sample; or a request to a service, with a function that receives the reply."""


class NoBus:
    """A bus that delivers nothing: the virtual loop carries all messages itself."""

    def publish(self, message: Message) -> None:
        """Send nothing."""

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        """Deliver nothing."""

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        """Deliver no request."""

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        raise NotImplementedError((question, request, timeout_s))

    def close(self) -> None:
        """Do nothing: there is no connection to close."""


@dataclass(slots=True)
class Program:
    """A loop with its queue; its next action is an event of the loop that states its ``turn``."""

    name: str
    loop: Loop
    queue: deque[Item] = field(default_factory=deque[Item])
    alive: bool = True
    busy: bool = False
    """True during a step, or while its results are published: incoming messages wait in the
    queue."""
    turn: int = 0
    """Counts the program's actions; an event of an older turn is void."""
    stopped_until_s: float = 0.0
    slow_s: float = 0.0
    """Time by which its next step is longer, in s."""
    slow_service: str = ""
    """Service whose step is longer; empty for the next step of any service."""
    computed_s: float = 0.0
    """Computing time of the current step, in s."""
    service: str = ""
    """Service whose step is in progress."""
    timed: bool = False
    """True if a timer requested it."""
    began_s: float = 0.0
    """Time that the step was given, in s."""
    refused: int = 0
    """Number of payloads that were invalid."""

    @property
    def runner(self) -> Runner:
        """Return the runner whose step is in progress."""
        return self.loop.runner(self.service)

    def runner_of(self, service: str) -> Runner:
        """Return the runner of a service; the only one if the program has another name."""
        runners = self.loop.runners
        return runners[0] if len(runners) == 1 else self.loop.runner(service)

    @property
    def boots_alike(self) -> bool:
        """Return whether all programs of its kind begin in the same state, since it has no
        instrument."""
        runners = self.loop.runners
        return len(runners) == 1 and runners[0].service.instrument is None

    def ready(self, now_s: float) -> Runner | None:
        """Return the first runner whose messages require a step."""
        return next((runner for runner in self.loop.runners if runner.ready(now_s)), None)

    def due(self, now_s: float) -> Runner | None:
        """Return the first runner whose timer requires a step."""
        return next((runner for runner in self.loop.runners if runner.due(now_s)), None)

    def kept_busy(self, now_s: float) -> tuple[Message, ...]:
        """Report to the actuator in the same program how long the current step took."""
        return self.loop.kept_busy(self.runner, now_s - self.began_s, self.computed_s, now_s)

    def forked(self, memo: dict[int, Any]) -> "Program":
        """Return a program that continues independently; constant parts are shared."""
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
