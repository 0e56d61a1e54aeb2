"""A law as it runs: its step, the force used as F_k, and the free response.

With the identified set the free response H takes the place of d·u in (1), (4) and (17): the scheme
works with the voltage v = (k/d)·H(u), of which its model d·v is k·H(u), and

    u_k = H_{k-1}⁻¹[ H_{k-1}(u_{k-1}) + (d/k)·(v_k - v_{k-1}) ],    d/k = d_p

where H_{k-1}(u_{k-1}) is H at the newest sample, and H_{k-1}⁻¹ is that of ``response.inverse``, one
period ahead. Only differences of H enter, so that zeros have no effect. The p of (6) is then k
times the error of H, and everything else, including the theorems, holds as printed. If H is the
line d_p·u, v is u.

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
    """Use of the free response by a law."""

    model: HysteresisModel
    """Free response H, whose memory each step advances by the applied voltage."""
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
    """Free response that takes the place of d·u; None: the straight line d·u."""


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
    """Return the arm model of a law: that of the rig, or for the printed set its own."""
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
        The rig's m, b, k, d; the printed set replaces them with its own.
    force_filter_s
        Time constant of the low-pass over F - F_r, in s; 0 for none.
    response
        The identified free response, for the identified set.
    output
        Delay and lag with which a voltage acts on the arm, for laws that look ahead.

    Raises
    ------
    ValueError
        If the period is not positive, the law cannot be made of its gains, or its set is the
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
    """Begin another segment or law without a bump, before the step with ``x_um``.

    Measured and applied values stay; F_k - F_{k-1} counts from ``force_mN``, so that a force which
    the law was not given before does not act as a step. The step that follows keeps the voltage of
    a resting arm where x_{r,k} = x and F_k = F_{r,k}.

    ``x_r_um`` and ``force_r_mN`` are x_{r,k-1} and F_{r,k-1}, those of the sample ``x_um``, if the
    references go on. A change of law in motion then does not show in the voltage as far as the
    model holds. If the references start again, there are none of k-1, and those of k take their
    place.

    ``seen_V`` is given if the law before had another equivalent of the voltage: v of
    ``equivalent_voltage_V``. The residual of the step that follows is then 0.
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

    Arguments are those of ``pbsmic.step``, but ``force_mN`` is the newest estimate.

    Parameters
    ----------
    memory
        Memory of the free response at the newest sample, last updated by u_{k-1} for a period. A
        law with the straight line does not use it.
    plan
        Motion that the references belong to, for a law that ``previews``.

    Raises
    ------
    TypeError
        If the state belongs to another law, or the law needs a memory that is not given.
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
    """Return the voltage as ``law`` sees it in V, or None where both laws see the same."""
    return None if law.free == before.free else _equivalent_V(law, applied_V, memory)


def _equivalent_V(law: Law, applied_V: float, memory: HysteresisState | None) -> float:
    """Return the voltage v of the present free response, or the applied voltage without one."""
    if law.free is None:
        return applied_V
    if memory is None:
        raise TypeError("a law with the identified response needs the response's memory")
    return displacement_um(law.free.model, memory) / law.free.um_per_V
