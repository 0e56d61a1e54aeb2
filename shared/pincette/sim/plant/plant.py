"""Simulated gripper: voltage output, amplifier, piezo, arms and contact; pure.

From the voltage to the tip, in µm, mN, V and s:

    voltage     ``drive``: output, amplifier, hysteresis and creep, up to where the arm would rest
    arms        ``plain_arm``: one mode against a spring, or
                ``joined_arms``: two modes, a passive arm that moves, and a part that is pressed in,
                sticks, falls and breaks; if one of these is configured

Each of these is advanced by its exact solution for an input that is constant over a substep. Not
modelled: modes above the second, the part's own mass (1 % of an arm's), attraction before contact.
"""

import math
from collections.abc import Sequence
from typing import Literal

from msgspec.structs import replace

from pincette.sim.plant.arms import arms_of
from pincette.sim.plant.drive import creep_alone, drive, quantised_V, rest_um, settling_s
from pincette.sim.plant.joined_arms import arms_force_mN, move_arms, rest_arms
from pincette.sim.plant.parameters import PlantParameters, plant_parameters
from pincette.sim.plant.plain_arm import move_plain_arm, plain_force_mN, rest_plain_arm
from pincette.sim.plant.state import PlantState

__all__ = [
    "PlantParameters",
    "PlantState",
    "advance",
    "contact_force_mN",
    "left_alone",
    "place_part",
    "plant_parameters",
    "play",
    "set_voltage",
    "start",
    "take_part",
]

SETTLED_DECAYS = 30.0
"""Number of time constants at constant voltage after which only creep remains (e⁻³⁰ = 1e-13)."""


def start() -> PlantState:
    """Return the arm at rest, unpoled: zero voltage, zero displacement."""
    return PlantState(0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0)


def left_alone(state: PlantState) -> PlantState:
    """Return the arm with its output at 0 V and no part: electrical state and motion only."""
    return replace(
        state,
        target_V=0.0,
        passive_um=0.0,
        passive_speed_um_per_s=0.0,
        joined=False,
        dent_um=0.0,
        part="removed",
        held_s=0.0,
        touched_s=0.0,
        bridged=False,
        bond_used=0.0,
        elapsed_s=0.0,
        events=(),
    )


def set_voltage(parameters: PlantParameters, state: PlantState, voltage_V: float) -> PlantState:
    """Set the target of the output stage, rounded to its step."""
    return replace(state, target_V=quantised_V(parameters, voltage_V))


def contact_force_mN(parameters: PlantParameters, state: PlantState) -> float:
    """Return the contact force in mN, compressive and positive.

    The force is negative if a part sticks and is pulled.
    """
    if not parameters.elaborate:
        return plain_force_mN(parameters, state)
    return arms_force_mN(parameters, state, rest_um(parameters, state))


def place_part(parameters: PlantParameters, state: PlantState) -> PlantState:
    """Put a part at ``contact_um``; if the driven tip is beyond it, the passive arm yields."""
    over_um = state.x_um - parameters.contact_um
    fresh = replace(state, held_s=0.0, dent_um=0.0, touched_s=0.0, bridged=False, bond_used=0.0)
    placed = replace(fresh, part="there", joined=False)
    if not parameters.elaborate or over_um <= 0.0:
        return placed
    return replace(
        placed, joined=True, passive_um=over_um, passive_speed_um_per_s=state.speed_um_per_s
    )


def take_part(
    parameters: PlantParameters, state: PlantState, how: Literal["removed", "lost"]
) -> PlantState:
    """Return the state without the part; the arms continue from their positions."""
    gone = replace(state, part=how, held_s=0.0, dent_um=0.0, touched_s=0.0, bridged=False)
    if parameters.elaborate and state.joined:
        # The tips of joined arms are kept, as are their speeds.
        return replace(gone, joined=False)
    return gone


def advance(parameters: PlantParameters, state: PlantState, dt_s: float) -> PlantState:
    """Advance by ``dt_s``: whole substeps, then the remaining time; results are bitwise
    reproducible.

    After the output and the modes have come to rest, the remaining time is one step: only creep
    remains, which is linear with a constant input, and the arm follows its equilibrium.
    """
    if not 0.0 <= dt_s < math.inf:
        raise ValueError(f"dt_s = {dt_s} s: must be positive and finite")
    moving_s = settled_s(parameters, state) if dt_s > parameters.substep_s else math.inf
    if dt_s - moving_s > parameters.substep_s:
        settled = advance(parameters, state, moving_s)
        return _creep_only(parameters, settled, dt_s - moving_s)
    whole = int(dt_s / parameters.substep_s + 1e-9)
    if whole:
        state, _, _ = _substeps(parameters, state, parameters.substep_s, whole)
    rest_s = dt_s - whole * parameters.substep_s
    return _substeps(parameters, state, rest_s, 1)[0] if rest_s > 1e-9 else state


def play(
    parameters: PlantParameters, state: PlantState, dt_s: float, voltages_V: Sequence[float]
) -> tuple[PlantState, list[float], list[float]]:
    """Output successive voltages, each for ``dt_s``, at most a substep; raises ValueError.

    Also returns the position in µm and the voltage at the amplifier's input in V after each.
    """
    if not 0.0 < dt_s <= parameters.substep_s:
        raise ValueError(
            f"dt_s = {dt_s} s: must be above 0 and at most a substep of {parameters.substep_s} s"
        )
    targets = [quantised_V(parameters, voltage_V) for voltage_V in voltages_V]
    return _substeps(parameters, state, dt_s, len(targets), targets)


def _substeps(
    p: PlantParameters,
    state: PlantState,
    dt_s: float,
    count: int,
    targets_V: Sequence[float] | None = None,
) -> tuple[PlantState, list[float], list[float]]:
    """Advance substeps of equal length.

    With targets, also returns position and voltage after each substep.
    """
    driven, rests_um, voltages_V = drive(p, state, dt_s, count, targets_V)
    with_positions = targets_V is not None
    if p.elaborate:
        start_um = rest_um(p, state)
        after, positions_um = move_arms(
            p, driven, dt_s, start_um, rests_um, with_positions=with_positions
        )
    else:
        after, positions_um = move_plain_arm(
            p, driven, dt_s, rests_um, with_positions=with_positions
        )
    return after, positions_um, voltages_V


def settled_s(p: PlantParameters, state: PlantState) -> float:
    """Return the time in s after which only creep remains; longer steps are divided there."""
    decay_per_s = p.damping_ratio * p.natural_frequency_rad_per_s
    if p.elaborate:
        decay_per_s = min(decay_per_s, arms_of(p).slowest_decay_per_s)
    return SETTLED_DECAYS * (1.0 / decay_per_s + settling_s(p, state))


def _creep_only(p: PlantParameters, state: PlantState, dt_s: float) -> PlantState:
    """Advance one step of any length with settled voltage; the arm ends at its equilibrium."""
    crept = creep_alone(p, state, dt_s)
    rest = rest_um(p, crept)
    return rest_arms(p, crept, dt_s, rest) if p.elaborate else rest_plain_arm(p, crept, rest)
