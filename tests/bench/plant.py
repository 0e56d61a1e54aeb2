"""Cost of a second of simulated time: each plant compared with a bare loop of multiplications.

The bare loop multiplies as often as the plant's formulas do, counted by hand below; both run in
turn, several times, and the minimum of each counts. Run by ``python -m tests.bench.plant``.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter

from pincette.config.simulation import Amplifier, Bead, SecondMode
from pincette.sim.instruments.fitting import resolved
from pincette.sim.plant import plant
from pincette.sim.plant.plant import PlantParameters, PlantState
from tests.support.rigs import demo_rig

PERIOD_S = 0.02
SECONDS = 2.0
ROUNDS = 5
PLAIN, ELABORATE = 24, 70
"""Multiplications of a substep: lag 1, hysteresis 4, displacement 3, creep 6, mode 10; two arms
besides: amplifier 5, three complex modes 24, bound 9, part 8."""


@dataclass(frozen=True, slots=True)
class Row:
    """One plant at one substep."""

    name: str
    substep_s: float
    plant_s: float
    bare_s: float

    def text(self) -> str:
        """Return the line of the table; times are per second of simulated time."""
        return (
            f"{self.name:<28} {1e3 * self.substep_s:6.2f} {1e3 * self.plant_s:10.2f} "
            f"{1e3 * self.bare_s:10.2f} {self.plant_s / self.bare_s:8.1f}"
        )


def main() -> None:
    """Print the table."""
    print(f"{'plant':<28} {'step':>6} {'plant':>10} {'bare':>10} {'ratio':>8}")
    print(f"{'':<28} {'ms':>6} {'ms per s':>10} {'ms per s':>10}")
    plain, elaborate = plants()
    for substep_s in (1e-3, 1e-4):
        for name, p, count, low_V in (
            ("one mode, free", plain, PLAIN, 0.0),
            ("one mode, in contact", plain, PLAIN, 2.0),
            ("two arms, free", elaborate, ELABORATE, 0.0),
            ("two arms, in contact", elaborate, ELABORATE, 2.0),
            ("two arms, touch and leave", elaborate, ELABORATE, 1.35),
        ):
            print(measured(name, replace(p, substep_s=substep_s), count, low_V).text())


def plants() -> tuple[PlantParameters, PlantParameters]:
    """Return the plants: the demo rig with one mode, and one with every effect that a plant can
    have."""
    simulation = demo_rig().simulation
    assert simulation is not None
    plain = resolved(simulation, "icpdas_i7024")
    elaborate = plain.model_copy(
        update={
            "second_mode": SecondMode(share=0.0255),
            "passive_natural_frequency_rad_per_s": 2437.8,
            "amplifier": Amplifier(saturation_V=10.0, slew_V_per_s=1e4, bandwidth_hz=2000.0),
            "part": Bead(modulus_GPa=37.95, adhesion_J_per_m2=0.05, break_force_mN=100.0),
        }
    )
    return plant.plant_parameters(plain), plant.plant_parameters(elaborate)


def measured(name: str, p: PlantParameters, count: int, low_V: float) -> Row:
    """Measure plant and bare loop in turn."""
    start = plant.advance(p, plant.set_voltage(p, plant.start(), low_V), 1.0)
    loops = round(SECONDS / p.substep_s)
    plant_s = bare_s = math.inf
    for _ in range(ROUNDS):
        plant_s = min(plant_s, _timed(lambda: _driven(p, start, low_V)))
        bare_s = min(bare_s, _timed(lambda: _bare(loops, count)))
    return Row(name, p.substep_s, plant_s / SECONDS, bare_s / SECONDS)


def _driven(p: PlantParameters, state: PlantState, low_V: float) -> PlantState:
    for tick in range(round(SECONDS / PERIOD_S)):
        voltage_V = low_V + 0.3 * (1.0 - math.cos(0.063 * tick))
        state = plant.advance(p, plant.set_voltage(p, state, voltage_V), PERIOD_S)
    return state


def _bare(loops: int, count: int) -> float:
    value = 1.0
    for _ in range(loops):
        for _ in range(count):
            value = value * 1.0000001
    return value


def _timed(work: Callable[[], object]) -> float:
    begin_s = perf_counter()
    work()
    return perf_counter() - begin_s


if __name__ == "__main__":
    main()
