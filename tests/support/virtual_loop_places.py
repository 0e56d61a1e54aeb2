"""Every state of a job, each as a loop that has reached it and can be forked."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from msgspec.structs import replace

from pincette.config import RigFile, parse_rig
from pincette.config.reading import laid_over
from pincette.control.planning.program import Program
from pincette.control.planning.segments import Press, Segment
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
KILOHERTZ, SHORT_S = DEMO.parent / "kilohertz.toml", 0.001
QUICKER = 0.4
"""Factor by which a segment of the program is shorter than at 20 ms."""
SHORT_PATIENCE_S = 0.0003
"""One and a half intervals at which an actuator checks its clock at that period, in s."""
FAST_LINES: Tree = {"sensor": {"timeout_s": 0.0005}, "output": {"timeout_s": 0.0005}}
"""Settings of the demo rig's instruments with exchanges short enough for that period."""
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
"""Number of ticks of 20 ms since the state was reached."""


@dataclass(frozen=True, slots=True)
class Place:
    """A loop in a state of its job."""

    state: str
    held: bool
    """True if the actuator knows that a part is held."""
    loop: VirtualLoop


def near_rig(period_s: float = T) -> RigFile:
    """Return that rig, in real time, with the ports of its file, which are not opened."""
    demo = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    if period_s == T:
        return parse_rig(laid_over(demo, NEAR))
    # Period, law and limits of the rig at 1 kHz, with its four services in separate programs; the
    # instruments are those whose bytes the virtual bench implements.
    assert period_s == SHORT_S
    fast = tomllib.loads(KILOHERTZ.read_text(encoding="utf-8"))
    del fast["base"], fast["sensor"], fast["output"]
    demo["law"] = fast.pop("law")
    fast["rig"] |= {"time": "real", "composed": []}
    return parse_rig(laid_over(laid_over(laid_over(demo, fast), FAST_LINES), NEAR))


def begun(seed: int = 1, period_s: float = T) -> VirtualLoop:
    """Return a rig that is reset and armed, and about to play."""
    loop = VirtualLoop(near_rig(period_s), seed)
    loop.run(loop.now_s + 3.0 * T)
    loop.reset()
    loop.arm(program_at(period_s), EPOCH)
    return loop


def program_at(period_s: float) -> Program:
    """Return the short grip, which is quicker at a short period."""
    if period_s == T:
        return PROGRAM
    return replace(PROGRAM, segments=tuple(map(_quicker, PROGRAM.segments)))


def _quicker(segment: Segment) -> Segment:
    quicker = replace(segment, duration_s=QUICKER * (segment.duration_s or 0.0))
    if not isinstance(quicker, Press) or quicker.move_s is None:
        return quicker
    return replace(quicker, move_s=QUICKER * quicker.move_s)


def view_of(loop: VirtualLoop) -> Telemetry | None:
    """Return the last message of the controller."""
    for _, message in reversed(loop.told or []):
        if isinstance(message, Telemetry):
            return message
    return None


def reach(loop: VirtualLoop, phase: str, ticks: int, *, paused: bool = False) -> None:
    """Let the program reach the n-th tick of a phase, in ticks of 20 ms."""
    period_s = loop.rig.rig.period_s
    count = ticks if period_s == T else round(ticks * QUICKER * T / period_s)

    def there() -> bool:
        view = view_of(loop)
        if view is None or view.phase != phase or view.paused != paused:
            return False
        return paused or view.segment_tick >= count

    assert loop.run(loop.now_s + 10.0, there), f"{phase} is not reached: {view_of(loop)}"
    if paused:
        loop.run(loop.now_s + ticks * T)


@cache
def place(state: str, period_s: float = T) -> Place:
    """Return a loop in this state; it is only forked, never run."""
    loop = begun(period_s=period_s)
    match state:
        case "idle":
            loop = VirtualLoop(near_rig(period_s), 1)
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
    """Stop right before a grid point of the sensor, so that a phase of the cycle is a delay."""
    due_at = loop.runner("sensor").due_at
    assert due_at is not None
    loop.run(due_at - 1e-6)


def composed_rig(*programs: str, period_s: float = T) -> RigFile:
    """Return the rig of these states, with some services composed and the timeouts that this
    requires."""
    rig = composing(near_rig(period_s), *programs)
    if period_s == SHORT_S:
        waits = {"timeout_s": SHORT_PATIENCE_S}
        return rig.model_copy(update={"sensor": rig.sensor.model_copy(update=waits)})
    services = loop_services()
    patience_s = min(
        shared_timeout_s(rig, [services[one] for one in member_services(name)])
        for name in rig.programs
    )
    waits = {"timeout_s": min(rig.sensor.timeout_s, patience_s)}
    return rig.model_copy(update={"sensor": rig.sensor.model_copy(update=waits)})


@cache
def composed_place(state: str, *programs: str, period_s: float = T) -> Place:
    """Return a loop of these programs in a state of its job; it is only forked, never run."""
    loop = VirtualLoop(composed_rig(*programs, period_s=period_s))
    loop.run(loop.now_s + 3.0 * T)
    loop.reset()
    if state != "idle":
        loop.arm(program_at(period_s), EPOCH)
        reach(loop, state, TICKS_IN[state])
    _rest_in_the_period(loop)
    echo = loop.newest
    assert echo.state == ("idle" if state == "idle" else "armed"), (state, echo)
    return Place(state, echo.part_held, loop)
