"""A simulated rig drawn at random, and its open-loop motions as the services would record them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from pincette.config import Simulation, read_rig
from pincette.control.planning.program import Segment
from pincette.control.planning.segments import Drive, paths_of
from pincette.core.messages import GroundTruth
from pincette.sim.rig.rig import SimulatedRig
from tests.support.drawn.random_rigs import random_simulation
from tests.support.drawn.true_values import TrueValues, true_values

PERIOD_S = 0.02
DEMO = read_rig(Path(__file__).parents[4] / "deploy" / "rigs" / "demo.toml")


def base() -> Simulation:
    """The demo rig's plant."""
    assert DEMO.simulation is not None
    return DEMO.simulation


@cache
def drawn(seed: int) -> Simulation:
    """Draw a plant at random, by ``random_rigs``."""
    return random_simulation(base(), seed)


@cache
def truth(seed: int) -> TrueValues:
    """Return the values that its calibrations should find."""
    return true_values(drawn(seed))


@dataclass(slots=True)
class Bench:
    """A plant moved by voltage only; each reading is stored with its voltage."""

    simulation: Simulation
    voltage_V: list[float] = field(default_factory=list[float])
    x_um: list[float] = field(default_factory=list[float])
    true_x_um: list[float] = field(default_factory=list[float])
    true_force_mN: list[float] = field(default_factory=list[float])
    applied_V: float = 0.0
    rig: SimulatedRig = field(init=False)

    def __post_init__(self) -> None:
        self.rig = SimulatedRig(
            self.simulation, PERIOD_S, lockstep=True, clock=lambda: 0.0, truth=self._know
        )

    def _know(self, truth: GroundTruth) -> None:
        self.true_x_um.append(truth.arms[0].x_um)
        self.true_force_mN.append(truth.arms[0].force_mN)

    def tick(self, voltage_V: float) -> float:
        """Read, output a voltage, and return the reading."""
        x_um = self.rig.measure_um()
        self.rig.put_out(voltage_V)
        self.x_um.append(x_um)
        self.voltage_V.append(self.applied_V)
        self.applied_V = voltage_V
        return x_um

    def play(
        self, segments: Sequence[Segment], tick: Callable[[float], object] | None = None
    ) -> dict[str, slice]:
        """Play segments of voltage, and return the samples of each phase, the last one by name."""
        places: dict[str, slice] = {}
        tick = tick or self.tick
        for segment in segments:
            assert isinstance(segment, Drive)
            assert segment.duration_s is not None
            first, start_V = len(self.x_um), self.applied_V
            for index in range(1, round(segment.duration_s / PERIOD_S) + 1):
                voltage_V = start_V
                for path in paths_of(segment):
                    begin_V = start_V if path.relative else 0.0
                    voltage_V = begin_V + path.at(index * PERIOD_S)
                tick(voltage_V)
            places[segment.phase] = slice(first, len(self.x_um))
        return places


def percent(found: float, true: float) -> float:
    """Return the error in per cent of the truth."""
    return 100.0 * (found / true - 1.0)


def table(head: str, rows: Sequence[Sequence[float]]) -> str:
    """Return rows of numbers under a header, and the largest magnitude of each column."""
    lines = [head, *(" ".join(f"{value:9.3f}" for value in row) for row in rows)]
    worst = np.max(np.abs(np.array(rows)), axis=0).tolist()
    return "\n".join([*lines, "worst", " ".join(f"{value:9.3f}" for value in worst)])
