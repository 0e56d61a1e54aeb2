"""A short grip in one process, in virtual time, on a rig that a script disturbs."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from unittest.mock import patch

from pincette.config import RigFile
from pincette.config.reading import laid_over
from pincette.control.planning.program import Guards, Program
from pincette.control.planning.segments import Move, Press, Rest, Seek
from pincette.core.messages import (
    Applied,
    Estimate,
    GroundTruth,
    Message,
    Position,
    RequestLog,
    Telemetry,
)
from pincette.engine import composed
from pincette.engine.composed import ComposedLoop
from pincette.engine.instrument import Device
from pincette.engine.simulated import devices_on, simulated_bench
from pincette.sim.rig.rig import SimulatedRig
from tests.support.rigs import Tree, demo_rig

T = 0.02
TRIPPED = ("frozen", "ramping")
NEAR: Tree = {
    "safety": {"freeze_s": 0.4},
    "part": {"contact_um": 6.0, "contact_tolerance_um": 1.5},
    "simulation": {"bead_contact_um": 6.2, "scripts": True},
}
PROGRAM = Program(
    segments=(
        Rest("zero", 0.3),
        Move("approach", 0.6, to_um=(4.0,)),
        Rest("approach", 0.3),
        Seek("contact", 0.8, to_um=(10.0,)),
        Press("load", 0.5, to_mN=8.0),
        Press("hold", 1.0, to_mN=8.0, move_s=0.3),
        Press("unload", 0.5, to_mN=0.0),
        Move("retreat", 0.5, to_um=(0.0,)),
    ),
    guards=Guards(2.0, 3, 40.0, 0.3, 5, 1.5, 2.9, 1.0),
    contact_stiffness_mN_per_um=2.17,
)
STOOD_S = 1.0


@dataclass(frozen=True)
class Played:
    """Messages of a program, in order; ``t_s`` of a tick is ``T`` times its number."""

    messages: list[Message]
    rig: SimulatedRig

    @cached_property
    def told(self) -> list[Message]:
        """Return all messages except requests, which name the rig file and with it its ports."""
        return [message for message in self.messages if not isinstance(message, RequestLog)]

    @cached_property
    def positions(self) -> list[Position]:
        return [message for message in self.messages if isinstance(message, Position)]

    @cached_property
    def estimates(self) -> list[Estimate]:
        return [message for message in self.messages if isinstance(message, Estimate)]

    @cached_property
    def applied(self) -> list[Applied]:
        return [message for message in self.messages if isinstance(message, Applied)]

    @cached_property
    def truths(self) -> list[GroundTruth]:
        return [message for message in self.messages if isinstance(message, GroundTruth)]

    @cached_property
    def outcome(self) -> str:
        """Return the outcome that the controller states."""
        return [message.outcome for message in self.messages if isinstance(message, Telemetry)][-1]

    @cached_property
    def trip(self) -> Applied | None:
        """Return the first message of the actuator that it has tripped; None if it never did."""
        return next((echo for echo in self.applied if echo.state in TRIPPED), None)

    def begin_of(self, phase: str) -> int:
        """Return the number of the first tick of a phase."""
        views = [message for message in self.messages if isinstance(message, Telemetry)]
        return next(view.seq for view in views if view.phase == phase)


def a_rig(*orders: Tree, changes: Tree | None = None) -> RigFile:
    """Return the demo rig in lockstep, its bead near, with a script in its file."""
    near = laid_over(NEAR, {"simulation": {"script": list(orders)}})
    return demo_rig(laid_over(near, changes or {}), time="lockstep")


def play(
    *orders: Tree, changes: Tree | None = None, host_stands_at_s: float | None = None
) -> Played:
    """Grip on that rig; at ``host_stands_at_s`` the output receives nothing for ``STOOD_S``."""
    built: list[SimulatedRig] = []
    in_time_s = SimulatedRig.now_s

    def devices(rig_file: RigFile, publish: Callable[[GroundTruth], None]) -> dict[str, Device]:
        bench = simulated_bench(rig_file, publish)
        assert isinstance(bench.rig, SimulatedRig)
        built.append(bench.rig)
        return devices_on(bench, rig_file)

    def clock_s(rig: SimulatedRig) -> float:
        now_s = in_time_s(rig)
        stood = host_stands_at_s is not None and now_s >= host_stands_at_s - 0.5 * T
        return now_s + STOOD_S * stood

    with (
        patch.object(composed, "simulated_devices", devices),
        patch.object(SimulatedRig, "now_s", clock_s),
    ):
        loop = ComposedLoop(a_rig(*orders, changes=changes))
        return Played(loop.play(PROGRAM), built[0])
