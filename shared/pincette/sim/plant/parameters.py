"""Parameters of the plant, from the simulation tables of a rig file; pure."""

import math
from dataclasses import dataclass

from msgspec.structs import replace

from pincette.config import Simulation
from pincette.control.record import FrozenRecord
from pincette.sim.plant.amplifier import IDEAL, AmplifierParameters
from pincette.sim.plant.contact import (
    ball_weight_mN,
    capillary_mN,
    cube_root,
    hertz_um_per_mN23,
    holding_force_mN,
    pull_off_mN,
)
from pincette.sim.plant.hysteresis import BoucWen
from pincette.sim.plant.relays import Relays, loop_of_relays

FACES = 2
"""Number of faces of a part between two arms; both are compressed equally."""


class PartParameters(FrozenRecord, frozen=True):
    """Properties of the part between the arms, in addition to being rigid."""

    hertz_um_per_mN23: float = 0.0
    """Coefficient B of δ = B·F^(2/3), for all faces together."""
    pull_off_mN: float = 0.0
    """Pull at which dry faces separate, in mN."""
    hold_mN: float = 0.0
    """Smallest force that carries the part, in mN."""
    lift_after_s: float = math.inf
    break_mN: float = math.inf
    slip_mN: float = math.inf
    """Force in mN above which the face yields by ``slip_um``, ``slips`` times."""
    slip_um: float = 0.0
    slips: int = 0
    bridge_mN: float = 0.0
    """Pull of the liquid bridge at contact, in mN; 0 without liquid."""
    bridge_um: float = 0.0
    """Length √(V/(π·R)) over which the pull of the bridge decreases, in µm."""
    rupture_um: float = 0.0
    """Gap at which the bridge ruptures, in µm."""
    ageing_per_decade: float = 0.0
    bond_mN: float = 0.0
    """Pull that the bond withstands for 1 s, in mN; 0 without a bond."""
    bond_scale_mN: float = 1.0
    """Pull that shortens the life of the bond by a factor of e, in mN."""

    @property
    def clings(self) -> bool:
        """Return whether the adhesion depends on time or distance."""
        return self.bridge_mN > 0.0 or self.ageing_per_decade > 0.0 or self.bond_mN > 0.0

    @property
    def may_go(self) -> bool:
        """Return whether the part can fall or break."""
        return self.lift_after_s < math.inf or self.break_mN < math.inf


RIGID = PartParameters()
"""Rigid part that cannot fall, slip or break."""


@dataclass(frozen=True, slots=True, eq=False)
class PlantParameters:
    """Parameters of the plant.

    Instances compare equal only to themselves, so that their constants can be cached by identity.
    """

    natural_frequency_rad_per_s: float
    damping_ratio: float
    compliance_um_per_mN: float
    piezo_um_per_V: float
    hysteresis: BoucWen | Relays
    creep_per_decade: float
    output_step_V: float
    output_lag_s: float
    contact_um: float
    environment_stiffness_mN_per_um: float
    """Stiffness K_e of the part's support, in mN/µm; 0 without a part."""
    substep_s: float
    curvature_per_V: float = 0.0
    hysteresis_scale: float = 1.0
    hung_mN: float = 0.0
    """Weight attached to the driven tip, in mN, positive towards -x."""
    amplifier: AmplifierParameters = IDEAL
    second_share: float = 0.0
    second_frequency_ratio: float = 6.27
    second_damping_ratio: float = 0.026
    passive_natural_frequency_rad_per_s: float | None = None
    """Natural frequency of the passive arm in rad/s; None if it has no mass."""
    passive_damping_ratio: float = 0.026
    part: PartParameters = RIGID

    def __post_init__(self) -> None:
        for name in ("damping_ratio", "second_damping_ratio", "passive_damping_ratio"):
            if not 0 < getattr(self, name) < 1:
                raise ValueError(f"{name} = {getattr(self, name)}: must be between 0 and 1")

    @property
    def elaborate(self) -> bool:
        """Return whether the arms need more than one mode against a massless spring."""
        return (
            self.second_share > 0.0
            or self.passive_natural_frequency_rad_per_s is not None
            or replace(self.part, slip_mN=math.inf, slip_um=0.0, slips=0) != RIGID
        )


def plant_parameters(simulation: Simulation) -> PlantParameters:
    """Return the plant of a rig file; raises ValueError."""
    if simulation.output_step_V is None or simulation.output_lag_s is None:
        raise ValueError("output_step_V, output_lag_s: left to the driver and not resolved")
    second = simulation.second_mode
    hysteresis, curvature_per_V = _hysteresis(simulation)
    return PlantParameters(
        natural_frequency_rad_per_s=simulation.natural_frequency_rad_per_s,
        damping_ratio=simulation.damping_ratio,
        compliance_um_per_mN=simulation.compliance_um_per_mN,
        piezo_um_per_V=simulation.piezo_um_per_V,
        hysteresis=hysteresis,
        creep_per_decade=simulation.creep_per_decade,
        output_step_V=simulation.output_step_V,
        output_lag_s=simulation.output_lag_s,
        contact_um=simulation.bead_contact_um,
        environment_stiffness_mN_per_um=(
            simulation.environment_stiffness_mN_per_um if simulation.bead else 0.0
        ),
        substep_s=simulation.substep_s,
        curvature_per_V=curvature_per_V,
        amplifier=_amplifier(simulation),
        second_share=second.share,
        second_frequency_ratio=second.frequency_ratio,
        second_damping_ratio=second.damping_ratio,
        passive_natural_frequency_rad_per_s=simulation.passive_natural_frequency_rad_per_s,
        passive_damping_ratio=simulation.passive_damping_ratio,
        part=_part(simulation),
    )


def _hysteresis(simulation: Simulation) -> tuple[BoucWen | Relays, float]:
    """Return the parameters of the hysteresis, and the curvature of the line it is added to."""
    d, relays = simulation.piezo_um_per_V, simulation.relays
    if relays is not None:
        full_V = relays.full_drive_V
        coercive_V, spread_V = relays.coercive_share * full_V, relays.spread_share * full_V
        shares = loop_of_relays(d, relays.loop_share, full_V, coercive_V, spread_V, relays.centre_V)
        return shares, relays.curvature_per_V
    shape = simulation.bouc_wen
    bouc_wen = BoucWen(
        A_um_per_V=shape.A_over_d * d,
        b_per_V=shape.b_times_U / shape.full_drive_V,
        g_per_V=shape.g_times_U / shape.full_drive_V,
        asymmetry=shape.asymmetry,
    )
    return bouc_wen, shape.curvature_per_V


def _amplifier(simulation: Simulation) -> AmplifierParameters:
    wanted = simulation.amplifier
    return AmplifierParameters(
        wanted.gain_ratio,
        math.inf if wanted.saturation_V is None else wanted.saturation_V,
        math.inf if wanted.slew_V_per_s is None else wanted.slew_V_per_s,
        0.0 if wanted.bandwidth_hz is None else 1.0 / (2.0 * math.pi * wanted.bandwidth_hz),
    )


def _part(simulation: Simulation) -> PartParameters:
    part = simulation.part
    hertz, hold_mN = 0.0, 0.0
    if part.modulus_GPa is not None:
        hertz = FACES * hertz_um_per_mN23(part.radius_um, part.modulus_GPa)
    falls = part.friction is not None and part.lift_after_s is not None
    if part.friction is not None:
        weight_mN = ball_weight_mN(part.radius_um, part.density_kg_per_m3)
        hold_mN = holding_force_mN(weight_mN, part.friction) if falls else 0.0
    return PartParameters(
        hertz,
        pull_off_mN(part.radius_um, part.adhesion_J_per_m2, part.roughness),
        hold_mN,
        part.lift_after_s if falls and part.lift_after_s is not None else math.inf,
        math.inf if part.break_force_mN is None else part.break_force_mN,
        math.inf if part.slip_force_mN is None else part.slip_force_mN,
        part.slip_um,
        0 if part.slip_force_mN is None else part.slips,
        capillary_mN(part.radius_um, part.surface_tension_J_per_m2 * part.wetting)
        if part.liquid_um3
        else 0.0,
        math.sqrt(part.liquid_um3 / (math.pi * part.radius_um)),
        cube_root(part.liquid_um3),
        part.ageing_per_decade,
        part.bond_mN,
        part.bond_scale_mN,
    )
