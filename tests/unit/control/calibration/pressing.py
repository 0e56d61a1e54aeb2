"""The contact calibration on a bench: an integral controller of the force replaces the law."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pincette.config import Simulation, derived
from pincette.control.calibration.contact_stiffness import Swing, with_press_gain
from pincette.control.planning.calibration_programs import full_cycles
from pincette.control.planning.contact_plan import PlannedRig
from pincette.control.planning.contact_request import ContactRequest
from pincette.control.planning.contact_stiffness_program import (
    LEVEL_CYCLES,
    LEVELS_V,
    contact_stiffness_program,
    crest_force_mN,
    level_phase,
)
from pincette.control.planning.feasibility import PlanLimits
from pincette.control.planning.segments import paths_of
from pincette.control.response.free_calibration import FreeCalibration
from pincette.control.response.free_response import FreeSample
from pincette.control.response.identified_response import IdentifiedResponse, identified_response

from .bench import DEMO, PERIOD_S, Bench

STIFFEST_SOFTNESS = 0.5
"""Compliance in µm/mN, about s_p + 1/K_e of the stiffest drawn rig: the integral stays slow
enough."""


def request() -> ContactRequest:
    """Return the request with which the demo rig meets its part."""
    grip, part = DEMO.grip, DEMO.part
    return ContactRequest(
        load_s=grip.load_s,
        approach_um_per_s=grip.approach_um_per_s,
        seek_um_per_s=grip.seek_um_per_s,
        contact_force_mN=grip.contact_force_mN,
        zero_s=grip.zero_s,
        contact_um=part.contact_um,
        contact_tolerance_um=part.contact_tolerance_um,
        stiffness_mN_per_um=part.stiffness_mN_per_um,
        stiffness_tolerance=part.stiffness_tolerance,
    )


def roomy(rig: PlannedRig) -> PlannedRig:
    """Return the rig with limits that allow 2 V peak to peak."""
    limits = PlanLimits(-2.0, 6.0, -40.0, 150.0, 100.0, 20.0, rig.limits.acceleration_um_per_s2)
    return replace(rig, limits=limits)


@dataclass(slots=True)
class Pressed:
    """The record as the services would have made it, and the truth."""

    bench: Bench
    compliance_um_per_mN: float
    response: IdentifiedResponse
    force_mN: list[float] = field(default_factory=list[float])
    swings: list[Swing] = field(default_factory=list[Swing])
    approach: slice = field(default_factory=lambda: slice(0))

    def tick(self, voltage_V: float) -> float:
        """Take one sample; returns it and its force (53)."""
        x_um = self.bench.tick(voltage_V)
        self.response = self.response.updated(self.bench.voltage_V[-1], PERIOD_S)
        self.force_mN.append((self.response.position_um() - x_um) / self.compliance_um_per_mN)
        return self.force_mN[-1]

    def approached(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return positions and forces about the first contact."""
        x, force = np.array(self.bench.x_um), np.array(self.force_mN)
        return x[self.approach], force[self.approach]


def pressed(simulation: Simulation, free: FreeCalibration) -> Pressed:
    """Zero, seek, press and swing, as ``contact_stiffness_program`` says."""
    s_p, d_p = simulation.compliance_um_per_mN, free.gain.gain_um_per_V
    rig = replace(roomy(derived.planned_rig(DEMO)), piezo_um_per_V=d_p, compliance_um_per_mN=s_p)
    response = identified_response(free.model, d_p, free.model_residual_um)
    run = Pressed(Bench(simulation), s_p, response)
    wish = request()
    program = contact_stiffness_program(wish, rig)
    _seek(run, wish, 0.7 * wish.stand_off_um / d_p)
    _press(run, wish.contact_force_mN, crest_force_mN(wish, rig, max(LEVELS_V)))
    names = [segment.phase for segment in program.segments]
    places = run.bench.play(program.segments[names.index("mean") : -1], run.tick)
    x, force = np.array(run.bench.x_um), np.array(run.force_mN)
    for number, level_V in enumerate(LEVELS_V, start=1):
        phase = level_phase(number)
        (path,) = paths_of(program.segments[names.index(phase)])
        cycles = full_cycles(path, PERIOD_S, LEVEL_CYCLES)
        at = places[phase]
        judged = with_press_gain(x[at][cycles], force[at][cycles], s_p, free.press_gain)
        run.swings.append(Swing(level_V, x[at][cycles], judged))
    return run


def _seek(run: Pressed, wish: ContactRequest, stand_off_V: float) -> None:
    """Rise, rest and zero short of the part, then close slowly until it is met."""
    voltage_V, samples = 0.0, list[FreeSample]()
    for _ in range(100):
        voltage_V += stand_off_V / 100.0
        run.tick(voltage_V)
    for _ in range(50):
        run.tick(voltage_V)
        samples.append(run.response.sample(run.bench.x_um[-1]))
    run.response = run.response.rezero(samples, 20)
    first, met = len(run.force_mN), 0
    while met < 3:
        voltage_V += wish.seek_um_per_s * PERIOD_S / run.response.nominal_um_per_V
        met = met + 1 if run.tick(voltage_V) >= wish.contact_force_mN else 0
        assert voltage_V < 5.0
    run.approach = slice(first, len(run.force_mN) + 25)


def _press(run: Pressed, from_mN: float, to_mN: float) -> None:
    """Raise the force in 4 s, and rest for one."""
    d_p = run.response.nominal_um_per_V
    filtered_mN = run.force_mN[-1]
    for index in range(250):
        wanted_mN = from_mN + (to_mN - from_mN) * min(1.0, index / 200.0)
        filtered_mN += 0.5 * (run.force_mN[-1] - filtered_mN)
        step_V = 0.3 * STIFFEST_SOFTNESS * (wanted_mN - filtered_mN) / d_p
        run.tick(run.bench.applied_V + step_V)
