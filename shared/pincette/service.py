"""What a service is: inputs and outputs as data, and pure functions from state to state.

The runner does the rest: bus, clock, instrument, joins, deadlines, statistics, shutdown. Because
inputs are data, replay, documents and the links between programs need no second list.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, Protocol, TypeVar

from pincette.messages import Message
from pincette.topics import LOOP, Question, Topic

C = TypeVar("C")
S = TypeVar("S")
I = TypeVar("I")  # noqa: E741  the name of an inputs type, never of a number
R = TypeVar("R")

Role = Literal["trigger", "join", "pace"]


class RefusedError(Exception):
    """A question that a service will not act on; the text says why."""


@dataclass(frozen=True, slots=True)
class Acquired:
    """A buffered acquisition since the last tick: one sample each 1/``rate_hz``."""

    rate_hz: float
    x_um: tuple[float, ...]
    drive_V: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Reading:
    """What the position sensor said in this tick, or why it said nothing."""

    x_um: float
    fault: str = ""
    acquired: Acquired | None = None


@dataclass(frozen=True, slots=True)
class Drive:
    """An output for the instrument: put out this voltage before anything is published."""

    voltage_V: float


@dataclass(frozen=True, slots=True)
class Wave:
    """An output for the instrument: begin to put out these voltages, one each 1/``rate_hz``."""

    voltages_V: Sequence[float]
    rate_hz: float


@dataclass(frozen=True, slots=True)
class Look:
    """An output for the instrument: see that the wave it plays has not broken off."""


ForInstrument = Drive | Wave | Look


@dataclass(frozen=True, slots=True)
class Input:
    """One input of a service.

    ``trigger``  each arrival makes the service step.
    ``join``     the step for sample k waits for this topic's sample k + ``offset``.
    ``pace``     in lockstep, each arrival begins the next tick; in real time the grid does.
    """

    topic: Topic
    role: Role
    offset: int = 0


@dataclass(frozen=True)
class Service(Generic[R, C, S, I]):
    """One program of the loop: data and pure functions.

    ``inputs_type`` is a NamedTuple whose fields are ``device`` (where there is an instrument)
    followed by the topics of ``inputs`` whose role is trigger or join, in their order. A step
    that is made because time has passed gets None for all of them.
    """

    name: str
    summary: str
    inputs: tuple[Input, ...]
    outputs: tuple[Topic, ...]
    questions: tuple[Question, ...]
    inputs_type: Callable[..., I]
    configure: Callable[[R], C]
    start: Callable[[C], S]
    step: Callable[[C, S, I, float], tuple[S, tuple[Message | ForInstrument, ...]]]
    answer: Callable[[C, S, Message, float], tuple[S, Message, tuple[Message | ForInstrument, ...]]]
    instrument: Literal["position_sensor", "voltage_output"] | None = None
    wake_s: Callable[[C], float] | None = None
    """In real time, step at least this often; None: only when something comes."""
    adopt: Callable[[C, S, float], S] | None = None
    """Begin from the voltage that the instrument puts out, whoever set it."""
    carried: tuple[str, ...] = ()
    """Fields of the state that an arming takes over from before, for what its outputs depend on."""
    may_feed: Callable[[C, S, float], bool] | None = None
    """Whether an instrument with a watchdog may hear that its host lives; None: at all times."""
    wind_down: Callable[[C, S, float], tuple[S, bool]] | None = None
    """Begin, or go on, to bring the instrument to rest before the program ends; true at rest."""


AnyService = Service[Any, Any, Any, Any]

WHOLE, AND = "loop", "+"
"""Name of the program that composes the whole loop, and what joins those of others' services."""


def services_of(program: str) -> tuple[str, ...]:
    """Services of the loop that a program runs, in the order of a tick.

    ``sensor`` is a program of one service, ``estimator+controller`` composes two, ``loop`` all; a
    program outside the loop runs none.
    """
    if program == WHOLE:
        return LOOP
    names = program.split(AND)
    return tuple(name for name in LOOP if name in names)


def composed_name(text: str) -> str:
    """The name of a program that composes several services, as it is known by: in their order.

    Raises
    ------
    ValueError
        Where a name is no service's, or comes twice, or there are fewer than two.
    """
    wanted = f"wanted {WHOLE!r}, or at least two of {', '.join(LOOP)} with {AND!r} between"
    names = list(LOOP) if text == WHOLE else text.split(AND)
    odd = [name for name in names if name not in LOOP]
    if odd:
        raise ValueError(f"{odd[0]!r} is no service of the loop: {wanted}")
    if len(set(names)) < len(names) or len(names) < 2:
        raise ValueError(f"{text!r} composes nothing: {wanted}")
    ordered = tuple(name for name in LOOP if name in names)
    return WHOLE if ordered == LOOP else AND.join(ordered)


class Participant(Protocol):
    """What others see of a program of the loop: what it takes of them, gives and answers."""

    @property
    def name(self) -> str:
        """The program's; see ``services_of``."""
        ...

    @property
    def inputs(self) -> tuple[Input, ...]:
        """What it takes of other programs."""
        ...

    @property
    def questions(self) -> tuple[Question, ...]:
        """What it answers."""
        ...


@dataclass(frozen=True, slots=True)
class Composed:
    """Several services as one program; what they tell each other is no input of it."""

    name: str
    services: tuple[AnyService, ...]
    """In the order of a tick."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        """What its services take of others."""
        own = services_of(self.name)
        return tuple(
            item
            for service in self.services
            for item in service.inputs
            if item.topic.producer not in own
        )

    @property
    def questions(self) -> tuple[Question, ...]:
        """What its services answer."""
        return tuple(question for service in self.services for question in service.questions)
