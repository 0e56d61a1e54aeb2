"""Definition of a service: inputs and outputs as data, and pure functions from state to state.

The runner provides everything else: bus, clock, instrument, joins, deadlines, statistics, shutdown.
Because inputs are data, replay, documents and the links between programs need no second list.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from pincette.control.record import FrozenRecord
from pincette.core import plugins
from pincette.core.faults import Fault, Predecessor
from pincette.core.messages import Message
from pincette.core.topics import LOOP, Request, Topic

C = TypeVar("C")
S = TypeVar("S")
I = TypeVar("I")  # noqa: E741  the name of an inputs type, never of a number
R = TypeVar("R")

Role = Literal["trigger", "join", "pace"]


class RefusedError(Exception):
    """Error for a request that a service refuses; the text gives the reason."""


class Acquired(FrozenRecord, frozen=True):
    """Buffered samples acquired since the last tick, one every 1/``rate_hz``."""

    rate_hz: float
    x_um: tuple[float, ...]
    drive_V: tuple[float, ...]


class ArmReading(FrozenRecord, frozen=True):
    """Measurement of one arm's position sensor in this tick, or the reason why there is none."""

    x_um: float
    fault: Fault | None = None
    acquired: Acquired | None = None


class Reading(FrozenRecord, frozen=True):
    """Measurements of the position sensors of all arms in this tick."""

    arms: tuple[ArmReading, ...]


class SetVoltage(FrozenRecord, frozen=True):
    """Output of a step to the instruments: apply these voltages before anything is published."""

    voltages_V: tuple[float, ...]
    """Voltage of each arm, in V."""


class WriteParts(FrozenRecord, frozen=True):
    """Output of a step to the instrument: apply these voltages one after another, and keep the last
    one.
    """

    voltages_V: tuple[float, ...]
    interval_s: float
    """Time between two voltages, in s."""


class Wave(FrozenRecord, frozen=True):
    """Output of a step to the instrument: begin to play these voltages, one every 1/``rate_hz``."""

    voltages_V: Sequence[float]
    rate_hz: float


class CheckWave(FrozenRecord, frozen=True):
    """Output of a step to the instrument: check that the waveform has not been interrupted."""


class ReadBack(FrozenRecord, frozen=True):
    """Output of a step to the instrument: read back its voltage; ``PutOut`` replaces this
    message.
    """


class PutOut(FrozenRecord, frozen=True):
    """Voltages that the outputs of all arms report."""

    voltages_V: tuple[float, ...]


class Slept(FrozenRecord, frozen=True):
    """Message that the machine was suspended for ``slept_s``; the clocks given to steps do not
    include this time.
    """

    slept_s: float


class Busy(FrozenRecord, frozen=True):
    """Message that another service of the same program ran for ``busy_s``; this is not a stall."""

    busy_s: float


DeviceCommand = SetVoltage | WriteParts | Wave | CheckWave | ReadBack


@dataclass(frozen=True, slots=True)
class Input:
    """One input of a service.

    The role ``trigger`` means that each arrival makes the service step. With ``join``, the step for
    sample k waits for sample k + ``offset`` of this topic. With ``pace``, each arrival begins the
    next tick in lockstep; in real time the grid does.
    """

    topic: Topic
    role: Role
    offset: int = 0


@dataclass(frozen=True)
class Service(Generic[R, C, S, I]):
    """One program of the loop: data and pure functions.

    ``inputs_type`` is a record whose fields are ``device`` (if there is an instrument) followed by
    the topics of ``inputs`` whose role is trigger or join, in their order. In a step that a timer
    causes, all topics are None.
    """

    name: str
    summary: str
    inputs: tuple[Input, ...]
    outputs: tuple[Topic, ...]
    requests: tuple[Request, ...]
    inputs_type: Callable[..., I]
    configure: Callable[[R], C]
    start: Callable[[C], S]
    step: Callable[[C, S, I, float], tuple[S, tuple[Message | DeviceCommand, ...]]]
    handle: Callable[[C, S, Message, float], tuple[S, Message, tuple[Message | DeviceCommand, ...]]]
    instrument: Literal["position_sensor", "voltage_output"] | None = None
    wake_s: Callable[[C], float] | None = None
    """Function that returns the longest time between two steps in real time, in s; None: only a
    message causes a step."""
    timer_s: Callable[[C, S], float] | None = None
    """Function that returns the time between two timer steps in a state, in real time, in s; None:
    one control period for a sensor, ``wake_s`` for others."""
    initialize_from_output: Callable[[C, S, tuple[float, ...]], S] | None = None
    """Function that returns the initial state for the voltages that the arms' instruments report,
    whatever program set them.
    """
    booted: Callable[[S, Predecessor], S] | None = None
    """Function that adapts the initial state to how an earlier program ended; None: the initial
    state does not depend on it."""
    ending: Callable[[S], Predecessor] | None = None
    """Function that returns how the end of this program is reported to the next one when it is
    stopped; None: no report."""
    state_snapshot: tuple[str, ...] = ()
    """Fields of the state that an arming does not reset and on which outputs depend."""
    may_kick_watchdog: Callable[[C, S, float], bool] | None = None
    """Function that returns whether an instrument with a watchdog may receive a heartbeat; None: it
    always may."""
    shutdown: Callable[[C, S, float], tuple[S, bool]] | None = None
    """Function that brings the instrument to rest before the program ends, step by step; it returns
    true once the instrument is at rest.
    """


AnyService = Service[Any, Any, Any, Any]

LOOP_PROGRAM, SEPARATOR = "loop", "+"
"""Name of the program that runs the whole loop, and the separator of services in other program
names.
"""


def programs() -> list[str]:
    """Return all programs that `pincette run` can start, except compositions."""
    return [*LOOP, *plugins.names(plugins.PROGRAMS)]


def member_services(program: str) -> tuple[str, ...]:
    """Return the services that a program of the loop runs, in the order of a tick.

    Return None for other programs.
    """
    if program == LOOP_PROGRAM:
        return LOOP
    names = program.split(SEPARATOR)
    return tuple(name for name in LOOP if name in names)


def canonical_name(text: str) -> str:
    """Return the standard name of a program that runs several services: their names in the order of
    a tick.

    Raises ValueError if a service is unknown.
    """
    wanted = (
        f"must be {LOOP_PROGRAM!r}, or at least two of {', '.join(LOOP)} with {SEPARATOR!r} between"
    )
    names = list(LOOP) if text == LOOP_PROGRAM else text.split(SEPARATOR)
    odd = [name for name in names if name not in LOOP]
    if odd:
        raise ValueError(f"{odd[0]!r} is not a service of the loop: {wanted}")
    if len(set(names)) < len(names) or len(names) < 2:
        raise ValueError(f"{text!r} composes nothing: {wanted}")
    ordered = tuple(name for name in LOOP if name in names)
    return LOOP_PROGRAM if ordered == LOOP else SEPARATOR.join(ordered)


@dataclass(frozen=True, slots=True)
class CompositeService:
    """Several services run as one program; messages between them are not inputs of the program."""

    name: str
    services: tuple[AnyService, ...]
    """Services in the order of a tick."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Return the inputs that its services need from other programs."""
        own = member_services(self.name)
        return tuple(
            item
            for service in self.services
            for item in service.inputs
            if item.topic.producer not in own
        )

    @property
    def requests(self) -> tuple[Request, ...]:
        """Return the requests that its services serve."""
        return tuple(request for service in self.services for request in service.requests)


Participant = AnyService | CompositeService
"""Properties of a loop program that others use: name, inputs and requests."""
