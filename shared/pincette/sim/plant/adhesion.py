"""Adhesion that keeps a part on the driven arm after it is no longer pressed; pure functions.

dry 3/2·π·w·R, times the roughness: Johnson, Kendall and Roberts, Proc. R. Soc. A 324 (1971); it
ends with the contact liquid 4·π·R·γ·cos θ·(1 - H/√(H² + V/(π·R))) across a gap H: Rabinovich,
Esayanur and Moudgil, Langmuir 21 (2005); the bridge ruptures at V^(1/3): Lian, Thornton and Adams,
J. Colloid Interface Sci. 161 (1993) ageing both grow by a share with each decade of contact time:
Bocquet, Charlaix, Ciliberto and Crassous, Nature 396 (1998) bond residue or glue lasts 1 s·e^((B -
P)/b) under a pull P: Bell, Science 200 (1978); so its strength grows with the logarithm of the rate
of the pull, and under any constant pull it breaks after a time

The bridge pulls the driven arm; the passive arm is assumed to be at rest.
"""

import math

from msgspec.structs import replace

from pincette.sim.plant.parameters import PartParameters, PlantParameters
from pincette.sim.plant.state import PlantState

MOST_EXPONENT = 50.0
"""Exponent beyond which a bond breaks at once."""
ITERATIONS, SETTLED_UM = 100, 1e-9


def strength_mN(part: PartParameters, state: PlantState) -> float:
    """Return the pull at which the faces separate, in mN; infinite while a bond holds them."""
    if part.bond_mN > 0.0 and state.bond_used < 1.0:
        return math.inf
    aged = 1.0 + part.ageing_per_decade * math.log10(1.0 + state.touched_s)
    return (part.pull_off_mN + part.bridge_mN) * aged


def bridge_pull_mN(part: PartParameters, gap_um: float) -> float:
    """Return the pull of the liquid bridge across a gap, in mN."""
    gap_um = max(0.0, gap_um)
    return part.bridge_mN * (1.0 - gap_um / math.hypot(gap_um, part.bridge_um))


def bridged_pull_mN(p: PlantParameters, state: PlantState, rest_um: float) -> float:
    """Return the pull of a bridge on an arm whose rest position without it is ``rest_um``, in mN.

    The gap of the arm at rest is H = x_b - x_f - s_p·P(H). Started from a wide gap, the iteration
    converges to the widest solution, or to contact if there is no solution. The pull depends only
    on the rest position, so that it cannot excite an oscillation.
    """
    if state.joined or not state.bridged:
        return 0.0
    free_um = p.contact_um - rest_um
    gap_um = free_um
    for _ in range(ITERATIONS):
        before_um, gap_um = (
            gap_um,
            free_um - p.compliance_um_per_mN * bridge_pull_mN(p.part, gap_um),
        )
        if gap_um <= 0.0 or before_um - gap_um < SETTLED_UM:
            break
    return bridge_pull_mN(p.part, gap_um)


def pulled_um(p: PlantParameters, state: PlantState, rest_um: float) -> float:
    """Return the rest position x_f shifted by a bridge, in µm: by s_p·P towards the part."""
    return rest_um + p.compliance_um_per_mN * bridged_pull_mN(p, state, rest_um)


def clung(p: PlantParameters, state: PlantState, dt_s: float, force_mN: float) -> PlantState:
    """Return the state with contact time, bridge and bond updated after ``dt_s`` under a force."""
    part, used = p.part, state.bond_used
    if state.part != "there":
        return replace(state, touched_s=0.0, bridged=False)
    bridged = part.bridge_mN > 0.0 and state.joined
    if state.bridged and not state.joined:
        bridged = p.contact_um - state.x_um + state.passive_um <= part.rupture_um
    if state.joined and part.bond_mN > 0.0 and used < 1.0:
        exponent = (-force_mN - part.bond_mN) / part.bond_scale_mN
        used += dt_s * math.exp(min(MOST_EXPONENT, exponent))
    touched_s = state.touched_s + dt_s if state.joined or bridged else 0.0
    return replace(state, touched_s=touched_s, bridged=bridged, bond_used=used)
