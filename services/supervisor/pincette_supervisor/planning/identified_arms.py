"""Arms and part of the model in use, advanced by one voltage after another; pure.

    output    τ·u̇ = u_target - u, the target arriving after the delay of the instruments
    free      x_1 by the identified free response, from sample to sample as u goes
    arm       one mode, ω_n and ζ, against K_e from x_e on (``sim.plant.plain_arm``)

The part between two arms is at its expected position. The ground holds it until both arms have
touched it; after that the arms carry it (``sim.plant.pair``).

The computation uses no value that only a simulated rig knows, since a real rig cannot know it.
"""

from dataclasses import dataclass, replace
from math import ceil, exp

from pincette.config import RigFile, derived
from pincette.config.rig_file import Part
from pincette.control.arm.shaping import ShapedStep
from pincette.control.laws.two_arms import Pair
from pincette.control.response.free_response import FreeResponse
from pincette.sim.plant import plant
from pincette.sim.plant.hysteresis import BoucWen
from pincette.sim.plant.pair import move_pair
from pincette.sim.plant.pair_state import (
    APART,
    PairParameters,
    PairState,
    pair_forces_mN,
    part_gone,
)
from pincette.sim.plant.parameters import PartParameters, PlantParameters
from pincette.sim.plant.plain_arm import move_plain_arm, rest_plain_arm
from pincette.sim.plant.state import PlantState
from pincette_supervisor.plugin import Present

SUBSTEP_S = 0.001
SETTLED_S = 60.0
"""Time for which the arm is assumed to have been at its first voltage, in s."""
STILL_V = 1e-9
"""The voltage counts as constant if it changes by less than this within a period, in V."""


Stretch = tuple[float, list[float]]
"""Length of a substep in s, and the rest position of the free arm in each substep, in µm."""
GROUND_MN = 1e6
"""Force with which the ground holds the part, in mN; practically unlimited, since it is unknown."""
HOLD_MN, LIFT_S = 0.05, 0.1
"""Assumed force of both arms from which they carry the part, in mN, and the time in s until they
carry it without the ground.
"""
SETTLE_S = 0.5
"""Time for which arms are assumed to have pressed at their voltages, in s."""


@dataclass(frozen=True, slots=True)
class Instruments:
    """Delay and lag between a sample and its voltage."""

    delay_s: float
    """Time from the sample to the arrival of the voltage, in s; less than a period."""
    lag_s: float
    """Time constant of the output, in s."""


@dataclass(frozen=True, slots=True)
class IdentifiedArm:
    """State of the arm; ``moved`` advances it by one period."""

    parameters: PlantParameters
    instruments: Instruments
    period_s: float
    response: FreeResponse
    state: PlantState
    target_V: float
    output_V: float
    missed_um: float = 0.0
    """Error of the free response at this tick of the program, from a residual table, in µm."""
    shaping_s: float | None = None
    """Interval between the parts of a shaped voltage step, in s; None: steps are not shaped."""
    hung_mN: float = 0.0
    """Weight at the tip, in mN, positive towards -x."""

    @property
    def tips_um(self) -> tuple[float, ...]:
        """Return the position of the tip, in µm."""
        return (self.state.x_um,)

    @property
    def forces_mN(self) -> tuple[float, ...]:
        """Return the contact force K_e·max(0, x - x_e), in mN."""
        return (plant.contact_force_mN(self.parameters, self.state),)

    @property
    def targets_V(self) -> tuple[float, ...]:
        """Return the target voltage of the arm, in V."""
        return (self.target_V,)

    def hang(self, weight_mN: float, arm: int = 1) -> "IdentifiedArm":
        """Hang a weight at the tip, in place of the present one."""
        _ = arm
        return replace(self, hung_mN=weight_mN)

    def at(self, x_um: float) -> "IdentifiedArm":
        """Return the free arm at rest at a measured position, with a memory for which it rests
        there.
        """
        response = self.response.begin(x_um)
        return replace(
            self, response=response, state=rest_plain_arm(self.parameters, self.state, x_um)
        )

    def moved(self, voltage_V: float, missed_um: float | None = None) -> "IdentifiedArm":
        """Return the arm one period after a sample that results in a voltage.

        ``missed_um`` is the error of the free response at the end of the period; None to keep the
        present one.
        """
        driven, stretches = self.driven(voltage_V, missed_um)
        state = self.state
        for dt_s, rests_um in stretches:
            state, _ = move_plain_arm(self.parameters, state, dt_s, rests_um)
        return replace(driven, state=state)

    def driven(
        self, voltage_V: float, missed_um: float | None = None
    ) -> tuple["IdentifiedArm", list[Stretch]]:
        """Return the arm with its response one period later but its tip unchanged, and the motion
        of x_f.

        The motion consists of stretches, each with substeps of one length and the rest positions of
        the free arm.
        """
        held = list[list[tuple[float, float]]]()
        output_V = self.output_V
        for length_s, target_V in self._targets(voltage_V):
            held.append(self._stretch(length_s, target_V, output_V))
            output_V = held[-1][-1][1] if held[-1] else output_V
        sag_um = self.parameters.compliance_um_per_mN * self.hung_mN
        before_um = self.response.position_um() - sag_um
        response = self.response.updated(output_V, self.period_s)
        missed_um = self.missed_um if missed_um is None else missed_um
        way_um = response.position_um() + missed_um - self.missed_um - sag_um - before_um
        travel_V, passed_s = output_V - self.output_V, 0.0
        stretches: list[Stretch] = []
        for stretch in held:
            rests_um = list[float]()
            for dt_s, reached_V in stretch:
                passed_s += dt_s
                # While the voltage is constant, only creep remains.
                share = passed_s / self.period_s
                if abs(travel_V) > STILL_V:
                    share = (reached_V - self.output_V) / travel_V
                rests_um.append(before_um + self.missed_um + share * way_um)
            if stretch:
                stretches.append((stretch[0][0], rests_um))
        driven = replace(
            self,
            response=response,
            target_V=voltage_V,
            output_V=output_V,
            missed_um=missed_um,
        )
        return driven, stretches

    def _targets(self, voltage_V: float) -> list[tuple[float, float]]:
        """Return the target voltages of the output over a period, each with its length in s."""
        rest_s = self.period_s - self.instruments.delay_s
        targets = [(self.instruments.delay_s, self.target_V)]
        if self.shaping_s is not None:
            *first_V, _ = ShapedStep(self.target_V, voltage_V, 0.0).parts_V()
            targets += [(self.shaping_s, part_V) for part_V in first_V]
            rest_s -= len(first_V) * self.shaping_s
        return [*targets, (rest_s, voltage_V)]

    def _stretch(
        self, length_s: float, target_V: float, output_V: float
    ) -> list[tuple[float, float]]:
        """Return equal substeps towards a target, each with its length and final voltage."""
        if length_s <= 0.0:
            return []
        count = ceil(length_s / SUBSTEP_S - 1e-9)
        dt_s, lag_s = length_s / count, self.instruments.lag_s
        decay, stretch = exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0, list[tuple[float, float]]()
        for _ in range(count):
            output_V = target_V + (output_V - target_V) * decay
            stretch.append((dt_s, output_V))
        return stretch


def identified_arm(
    rig: RigFile, instruments: Instruments, start_V: float, part: Part | None
) -> IdentifiedArm:
    """Return the arm at rest at a voltage that was applied from 0 V, unpoled.

    Parameters
    ----------
    rig
        The rig file with the model in use; its table ``simulation`` is not used.
    part
        Object in the way of the arm; None without one.
    """
    model = rig.model
    response = derived.free_response(model).updated(0.0, 0.0).begin(derived.X_START_UM)
    if start_V:
        response = response.updated(start_V, SETTLED_S)
    parameters = PlantParameters(
        natural_frequency_rad_per_s=model.natural_frequency_rad_per_s,
        damping_ratio=model.damping_ratio,
        compliance_um_per_mN=model.compliance_um_per_mN,
        piezo_um_per_V=model.piezo_um_per_V,
        hysteresis=BoucWen(0.0, 0.0, 0.0),
        creep_per_decade=0.0,
        output_step_V=1.0,
        output_lag_s=instruments.lag_s,
        contact_um=0.0 if part is None else part.contact_um,
        environment_stiffness_mN_per_um=0.0 if part is None else part.stiffness_mN_per_um,
        substep_s=SUBSTEP_S,
    )
    state = rest_plain_arm(parameters, plant.start(), response.position_um())
    return IdentifiedArm(
        parameters,
        instruments,
        rig.rig.period_s,
        response,
        state,
        start_V,
        start_V,
        shaping_s=rig.shaping_s,
    )


@dataclass(frozen=True, slots=True)
class IdentifiedPair:
    """State of both arms and the part; ``moved`` advances it by one period."""

    arms: tuple[IdentifiedArm, IdentifiedArm]
    """Response and output of each arm; the positions of the tips are in ``state``."""
    parameters: PairParameters
    state: PairState

    @property
    def tips_um(self) -> Pair:
        """Return x_1 and x_2, in µm."""
        return self.state.tips_um

    @property
    def forces_mN(self) -> Pair:
        """Return the forces of both arms on the part, in mN."""
        return pair_forces_mN(self.parameters, self.state)

    @property
    def targets_V(self) -> Pair:
        """Return the target voltages of both arms, in V."""
        first, second = self.arms
        return first.target_V, second.target_V

    def hang(self, weight_mN: float, arm: int) -> "IdentifiedPair":
        """Hang a weight at the tip of arm 1 or 2, in place of the present one."""
        first, second = (
            each.hang(weight_mN) if number == arm else each
            for number, each in enumerate(self.arms, start=1)
        )
        return replace(self, arms=(first, second))

    def moved(self, voltages_V: Pair) -> "IdentifiedPair":
        """Return both arms one period after a sample that results in these voltages."""
        (first, ways_1), (second, ways_2) = (
            arm.driven(voltage_V) for arm, voltage_V in zip(self.arms, voltages_V, strict=True)
        )
        state = self.state
        for (dt_s, rests_1), (_, rests_2) in zip(ways_1, ways_2, strict=True):
            rests = tuple(zip(rests_1, rests_2, strict=True))
            state = move_pair(self.parameters, state, dt_s, rests)
        return replace(self, arms=(first, second), state=state)


def identified_pair(
    rig: RigFile, instruments: Instruments, present: Present, *, part: bool, held: bool
) -> IdentifiedPair:
    """Return both arms at rest at their positions; raises ValueError on a rig of one arm.

    Parameters
    ----------
    rig
        The rig file with the model in use; its table ``simulation`` is not used.
    part
        True if the part is present.
    held
        True if both arms press the part, which is then between their tips.
    """
    first_rig, second_rig = rig.arms
    first = identified_arm(first_rig, instruments, present.stand_V(rig), None)
    second_V = rig.safety.safe_V if present.second_V is None else present.second_V
    second = identified_arm(second_rig, instruments, second_V, None)
    if not held and present.x_um is not None:
        first = first.at(present.x_um)
    if not held and present.second_um is not None:
        second = second.at(present.second_um)
    contacts_um = first_rig.part.contact_um, second_rig.part.contact_um
    part_um = contacts_um[0]
    if held and present.x_um is not None and present.second_um is not None:
        part_um += 0.5 * (present.x_um - present.second_um - contacts_um[0] + contacts_um[1])
    parameters = PairParameters(
        first.parameters,
        second.parameters,
        gap_um=sum(contacts_um),
        part_um=part_um,
        face_mN_per_um=2.0 * rig.part.stiffness_mN_per_um,
        ground_slip_mN=GROUND_MN,
        part=PartParameters(hold_mN=HOLD_MN, lift_after_s=LIFT_S),
        lands=True,
    )
    state = PairState(first.state, second.state, part_um, part_um, APART)
    if not part:
        state = part_gone(state, "removed")
    # An arm that presses at its voltage is held at rest by the part.
    rests = first.state.x_um, second.state.x_um
    state = move_pair(parameters, state, SUBSTEP_S, [rests] * round(SETTLE_S / SUBSTEP_S))
    return IdentifiedPair((first, second), parameters, state)
