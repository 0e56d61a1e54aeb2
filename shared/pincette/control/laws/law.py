"""A law in operation: its step, the force used as F_k, and the free response.

With the identified set, the free response H replaces d·u in (1), (4) and (17): the scheme works
with the equivalent voltage v = (k/d)·H(u), for which its model gives d·v = k·H(u), and

    u_k = H_{k-1}⁻¹[ H_{k-1}(u_{k-1}) + (d/k)·(v_k - v_{k-1}) ],    d/k = d_p

where H_{k-1}(u_{k-1}) is H at the newest sample, and H_{k-1}⁻¹ is that of ``response.inverse``, one
period ahead. Only differences of H are used, so that zeros have no effect. The p of (6) is then k
times the error of H, and everything else, including the theorems, is valid as printed. If H is the
line d_p·u, v equals u.

Equation numbers are those of Q. Xu, IEEE T-ASE 10(3), 2013.
"""

from dataclasses import dataclass
from typing import Any

from msgspec.structs import replace

from pincette.control.arm.plant import (
    PROMPT,
    ArmParameters,
    DifferenceEquation,
    OutputTiming,
    discretize,
    printed_arm,
)
from pincette.control.force.estimation import smoothing
from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.laws.force_input import ForceInput, input_force
from pincette.control.laws.history import History, rest
from pincette.control.laws.parameters import ParameterSet
from pincette.control.laws.planned_motion import RESTING, PlannedMotion
from pincette.control.laws.sliding import LawOutput
from pincette.control.record import FrozenRecord
from pincette.control.response.hysteresis import (
    HysteresisModel,
    HysteresisState,
    displacement_um,
)
from pincette.control.response.inverse import voltage_for


@dataclass(frozen=True, slots=True)
class FreeResponseInput:
    """Data of the free response that a law uses."""

    model: HysteresisModel
    """Free response H. Each step updates its memory with the applied voltage."""
    um_per_V: float
    """Mean slope d/k = d_p of H, in µm/V."""
    period_s: float


@dataclass(frozen=True, slots=True)
class Law:
    """A law at one sampling period."""

    definition: LawDefinition
    plant: DifferenceEquation
    """Model of the arm that the law uses."""
    parameters: Any
    """Parameters from ``definition.build``."""
    force: ForceInput
    state_type: type
    """Type of ``LawState.law``."""
    free: FreeResponseInput | None = None
    """Free response that replaces d·u; None: the straight line d·u."""


class LawState(FrozenRecord, frozen=True):
    """State of a law between ticks."""

    law: Any
    """State of the scheme."""
    x_d_um: float
    """Desired position x_{d,k-1}, in µm."""
    force_r_mN: float
    """Reference force F_{r,k-1}, in mN."""
    force_error_mN: float
    """Low-passed force error F - F_r, in mN."""


def model_of(
    parameter_set: ParameterSet,
    arm: ArmParameters,
    period_s: float,
    output: OutputTiming = PROMPT,
) -> DifferenceEquation:
    """Return the arm model that a law uses: the rig's, or the paper's for the printed set."""
    return discretize(printed_arm() if parameter_set == "printed" else arm, period_s, output)


def build(
    settings: LawSettings,
    arm: ArmParameters,
    period_s: float,
    force_filter_s: float,
    response: HysteresisModel | None = None,
    output: OutputTiming = PROMPT,
) -> Law:
    """Build a law from its settings.

    Parameters
    ----------
    arm
        The rig's m, b, k, d; not used with the printed set, which has its own.
    force_filter_s
        Time constant of the low-pass over F - F_r, in s; 0 for none.
    response
        The identified free response, for the identified set.
    output
        Delay and lag with which a voltage acts on the arm, for laws with ``previews``.

    Raises
    ------
    ValueError
        If the period is not positive, the gains are not possible for the law, or the set is the
        identified one and there is no response.
    """
    definition = settings.definition
    plant = model_of(settings.set, arm, period_s, output)
    parameters = definition.build(plant, settings.gains, period_s)
    planned = settings.force_age == "planned"
    filter_s = 0.0 if definition.previews else force_filter_s
    force = ForceInput(planned, smoothing(period_s, filter_s) if planned else 0.0)
    at_rest: object = definition.start(
        parameters,
        rest(x_um=0.0, force_mN=0.0, applied_V=0.0),
        x_um=0.0,
        x_r_um=0.0,
        force_error_mN=0.0,
    )
    free = None
    if settings.set == "identified":
        if response is None:
            raise ValueError(
                'set = "identified", but no free response is identified: calibrate '
                'free_response, or use set = "consistent"'
            )
        free = FreeResponseInput(response, arm.d / arm.k, period_s)
    return Law(definition, plant, parameters, force, type(at_rest), free)


def start(
    law: Law,
    *,
    x_um: float,
    x_r_um: float,
    force_mN: float,
    applied_V: float,
    memory: HysteresisState | None = None,
) -> LawState:
    """Return the state of a resting arm with F_r = F; for ``memory`` see ``step``."""
    seen_V = _equivalent_V(law, applied_V, memory)
    history = rest(x_um=x_um, force_mN=force_mN, applied_V=seen_V)
    return _start(law, history, x_um, x_r_um, force_mN, force_mN)


def rebase(
    law: Law,
    state: LawState,
    *,
    x_um: float,
    x_r_um: float,
    force_mN: float,
    force_r_mN: float,
    seen_V: float | None = None,
) -> LawState:
    """Return the state for a bumpless start of a segment or law, before the step with ``x_um``.

    Measured and applied values are kept. F_k - F_{k-1} is computed relative to ``force_mN``, so
    that a force that the law has not used before does not act as a step. The next step does not
    change the voltage of a resting arm if x_{r,k} = x and F_k = F_{r,k}.

    If the references continue, ``x_r_um`` and ``force_r_mN`` are x_{r,k-1} and F_{r,k-1}, which
    belong to the sample ``x_um``. A change of law in motion then does not affect the voltage,
    provided that the model is accurate. If the references start again, those of k are used, since
    none exist for k-1.

    ``seen_V`` is the v of ``equivalent_voltage_V``, given if it differs from that of the previous
    law. The residual of the next step is then 0.
    """
    history = replace(state.law.history, force_mN=force_mN)
    if seen_V is not None:
        history = replace(history, applied_V=seen_V, coasting_um=x_um)
    elif law.definition.previews and type(state.law) is law.state_type:
        error_mN = force_mN - force_r_mN
        inner = replace(state.law, history=history)
        if law.definition.rebase is not None:
            inner = law.definition.rebase(inner)
        return LawState(inner, state.x_d_um, force_r_mN, error_mN)
    return _start(law, history, x_um, x_r_um, force_mN, force_r_mN)


def _start(
    law: Law,
    history: History,
    x_um: float,
    x_r_um: float,
    force_mN: float,
    force_r_mN: float,
) -> LawState:
    error_mN = force_mN - force_r_mN
    inner = law.definition.start(
        law.parameters, history, x_um=x_um, x_r_um=x_r_um, force_error_mN=error_mN
    )
    return LawState(inner, x_um, force_r_mN, error_mN)


def step(
    law: Law,
    state: LawState,
    *,
    x_um: float,
    force_mN: float,
    applied_V: float,
    x_r_um: float,
    force_r_mN: float,
    limited: int,
    memory: HysteresisState | None = None,
    plan: PlannedMotion = RESTING,
) -> tuple[LawState, LawOutput]:
    """Compute u_k with the force F_k of ``input_force``.

    The arguments are those of ``pbsmic.step``, except that ``force_mN`` is the newest estimate.

    Parameters
    ----------
    memory
        Memory of the free response at the newest sample, last updated by u_{k-1} for a period. Not
        used by a law with the straight line.
    plan
        Motion that the references belong to, for a law with ``previews``.

    Raises
    ------
    TypeError
        If the state belongs to another law, or a memory that the law needs is not given.
    """
    if type(state.law) is not law.state_type:
        raise TypeError("the state belongs to another law: rebase it first")
    force_mN, error_mN = input_force(
        law.force, force_mN, force_r_mN, state.force_r_mN, state.force_error_mN
    )
    after, output = law.definition.step(
        law.parameters,
        state.law,
        x_um=x_um,
        force_mN=force_mN,
        applied_V=_equivalent_V(law, applied_V, memory),
        x_r_um=x_r_um,
        force_r_mN=force_r_mN,
        limited=limited,
        **({"plan": plan} if law.definition.previews else {}),
    )
    if law.free is not None and memory is not None:
        voltage_V = voltage_for(
            law.free.model,
            memory,
            law.free.um_per_V * output.voltage_V,
            um_per_V=law.free.um_per_V,
            period_s=law.free.period_s,
        )
        output = replace(output, voltage_V=voltage_V)
    return LawState(after, output.x_d_um, force_r_mN, error_mN), output


def equivalent_voltage_V(
    law: Law, before: Law, applied_V: float, memory: HysteresisState | None
) -> float | None:
    """Return the equivalent voltage v of ``law`` in V, or None if it equals that of ``before``."""
    return None if law.free == before.free else _equivalent_V(law, applied_V, memory)


def _equivalent_V(law: Law, applied_V: float, memory: HysteresisState | None) -> float:
    """Return the voltage v for the present free response, or the applied voltage without one."""
    if law.free is None:
        return applied_V
    if memory is None:
        raise TypeError("a law with the identified response needs the response's memory")
    return displacement_um(law.free.model, memory) / law.free.um_per_V
