"""Every state a job can be in, each as a loop that has come there and can be forked."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from pincette.config import RigFile, parse_rig
from pincette.config.reading import laid_over
from pincette.core.faults import ActionCode
from pincette.core.messages import Action, Telemetry
from pincette.core.service import member_services
from pincette.engine.process import loop_services
from pincette.engine.timing_budget import shared_timeout_s
from tests.support.partitions import composing
from tests.support.rigs import DEMO, Tree
from tests.support.scripted import PROGRAM
from tests.support.virtual_loop import VirtualLoop

T = 0.02
FREEZE_S = 0.12
EPOCH = 7
NEAR: Tree = {
    "safety": {"freeze_s": FREEZE_S},
    "part": {"contact_um": 6.0, "contact_tolerance_um": 1.5},
    "simulation": {"bead_contact_um": 6.2, "scripts": True},
}
"""The demo rig with its bead near; a freeze is short, since it is waited for very often."""
STATES = (
    "idle",
    "zero",
    "approach",
    "contact",
    "load",
    "hold",
    "paused",
    "stopping",
    "unload",
    "retreat",
)
TICKS_IN: Mapping[str, int] = {
    "zero": 4,
    "approach": 14,
    "contact": 6,
    "load": 8,
    "hold": 16,
    "paused": 5,
    "stopping": 3,
    "unload": 6,
    "retreat": 8,
}
"""How many ticks of the state have passed."""


@dataclass(frozen=True, slots=True)
class Place:
    """A loop in a state of its job."""

    state: str
    held: bool
    """Whether the actuator has been told that a part is held."""
    loop: VirtualLoop


def near_rig() -> RigFile:
    """That rig, in real time and on the ports of its file, which nobody opens."""
    return parse_rig(laid_over(tomllib.loads(DEMO.read_text(encoding="utf-8")), NEAR))


def begun(seed: int = 1) -> VirtualLoop:
    """A rig that is reset and armed, and about to play."""
    loop = VirtualLoop(near_rig(), seed)
    loop.run(loop.now_s + 3.0 * T)
    loop.reset()
    loop.arm(PROGRAM, EPOCH)
    return loop


def view_of(loop: VirtualLoop) -> Telemetry | None:
    """What the controller said last."""
    for _, message in reversed(loop.told or []):
        if isinstance(message, Telemetry):
            return message
    return None


def reach(loop: VirtualLoop, phase: str, ticks: int, *, paused: bool = False) -> None:
    """Let the program come to the n-th tick of a phase."""

    def there() -> bool:
        view = view_of(loop)
        if view is None or view.phase != phase or view.paused != paused:
            return False
        return paused or view.segment_tick >= ticks

    assert loop.run(loop.now_s + 10.0, there), f"{phase} is not reached: {view_of(loop)}"
    if paused:
        loop.run(loop.now_s + ticks * T)


@cache
def place(state: str) -> Place:
    """A loop in this state; to be forked, never to be run."""
    loop = begun()
    match state:
        case "idle":
            loop = VirtualLoop(near_rig(), 1)
            loop.run(loop.now_s + 5.0 * T)
            loop.reset()
            loop.run(loop.now_s + 5.0 * T)
        case "paused":
            reach(loop, "load", 6)
            loop.must("controller", Action(ActionCode.PAUSE))
            reach(loop, "load", TICKS_IN[state], paused=True)
        case "stopping":
            reach(loop, "approach", 10)
            loop.must("controller", Action(ActionCode.STOP))
            reach(loop, "stopping", TICKS_IN[state])
        case _:
            reach(loop, state, TICKS_IN[state])
    _rest_in_the_period(loop)
    echo = loop.newest
    assert echo.state == ("idle" if state == "idle" else "armed"), (state, echo)
    return Place(state, echo.part_held, loop)


def _rest_in_the_period(loop: VirtualLoop) -> None:
    """Stand right before a grid point of the sensor, so that a phase of the cycle is a delay."""
    due_at = loop.task("sensor").due_at
    assert due_at is not None
    loop.run(due_at - 1e-6)


def composed_rig(*programs: str) -> RigFile:
    """The rig of the places, with some services together and the patience that this asks for."""
    rig = composing(near_rig(), *programs)
    services = loop_services()
    patience_s = min(
        shared_timeout_s(rig, [services[one] for one in member_services(name)])
        for name in rig.programs
    )
    waits = {"timeout_s": min(rig.sensor.timeout_s, patience_s)}
    return rig.model_copy(update={"sensor": rig.sensor.model_copy(update=waits)})


@cache
def composed_place(state: str, *programs: str) -> Place:
    """A loop of these programs in a state of its job; to be forked, never to be run."""
    loop = VirtualLoop(composed_rig(*programs))
    loop.run(loop.now_s + 3.0 * T)
    loop.reset()
    if state != "idle":
        loop.arm(PROGRAM, EPOCH)
        reach(loop, state, TICKS_IN[state])
    _rest_in_the_period(loop)
    echo = loop.newest
    assert echo.state == ("idle" if state == "idle" else "armed"), (state, echo)
    return Place(state, echo.part_held, loop)
