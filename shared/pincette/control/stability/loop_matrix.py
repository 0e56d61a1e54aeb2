"""The closed loop of arm, force observer and law, as one matrix for each case.

In each tick the position is measured, the observer computes the force from it and from x_1 =
d_p·u_{k-1}, the law computes u_k, and u_k is output. The model of the arm is exact
(``sampled_arm``). The matrices of observer and law are derived from the code that runs in each
tick, including the switching slope K_S/δ: with references of zero, inside the boundary layer and
within every limit, a step is linear in its inputs and its state, and column j of its matrix is the
response to a small j-th input. States without an effect are omitted.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from pincette.control.arm.plant import PROMPT, ArmParameters, OutputTiming
from pincette.control.arm.sampled_arm import LoopCase, sampled_arms
from pincette.control.checks import require_not_negative, require_positive
from pincette.control.force.observers import (
    ForceObserver,
    QuasiStatic,
    QuasiStaticParameters,
    state_of,
    with_state,
)
from pincette.control.laws import law as control_law
from pincette.control.laws.definition import Array, LawSettings
from pincette.control.laws.law import Law
from pincette.control.laws.planned_motion import PlannedMotion
from pincette.control.record import field_names

Value = TypeVar("Value")
ForceOfLaw = Literal["estimated", "true"]
ARM_STATES = 4
X, VOLTAGE = 0, 3
"""Indices of x and u_{k-1} among the states."""
SMALL = 2.0**-200
"""Size of the input for which a response is computed: inside any boundary layer, and a power of two
for exact scaling."""


@dataclass(frozen=True, slots=True)
class Loop:
    """Properties of the loop of a law on a rig.

    Raises
    ------
    ValueError
        If the period is not positive or a time constant negative.
    """

    law: LawSettings
    arm: ArmParameters
    """Identified arm of the rig, which law and estimator use as their model, unless the law has its
    own."""
    period_s: float
    force_filter_s: float = 0.0
    """Time constant of the low-pass of F - F_r, in s, which is used with planned forces."""
    output_lag_s: float = 0.0
    """Time constant of the first-order lag between output and arm, in s."""
    assumed_timing: OutputTiming = PROMPT
    """Delay and lag of a voltage that a law with ``previews`` assumes."""
    force: ForceOfLaw = "estimated"
    """``true`` gives the law K_e·x instead of the observer's force."""
    observer: ForceObserver | None = None
    """Force observer of the loop; None for the quasi-static one."""
    force_when_free: bool = False
    """True if the law also uses the force while the arm is free; False if it sets F = F_r = 0."""

    def __post_init__(self) -> None:
        require_positive("period", self.period_s, "s")
        require_not_negative("force filter", self.force_filter_s, "s")
        require_not_negative("output lag", self.output_lag_s, "s")

    def with_gains(self, **gains: float) -> "Loop":
        """Return the loop with other gains; raises ValueError if the law has no such gain."""
        return replace(self, law=self.law.with_gains(**gains))


def flatten(state: Any) -> list[float]:
    """Return the floats of a float or of nested dataclasses, in the order of their fields.

    Raises
    ------
    TypeError
        If the state contains anything else, which a matrix cannot represent.
    """
    if isinstance(state, float):
        return [state]
    names = field_names(state)
    if names is None:
        raise TypeError(f"a loop's state is made of floats, not of {type(state).__name__}")
    found: list[float] = []
    for name in names:
        found += flatten(getattr(state, name))
    return found


def refill(template: Value, values: Iterator[float]) -> Value:
    """Return a copy of the template with other floats; the inverse of ``flatten``."""
    whole: Any = template
    if isinstance(whole, float):
        found: Any = next(values)
        return found
    names = field_names(whole) or ()
    return type(whole)(*(refill(getattr(whole, name), values) for name in names))


def matrix_of(step: Callable[[list[float]], list[float]], inputs: int) -> Array:
    """Return the matrix of a linear step with ``inputs`` input numbers, shape (outputs, inputs)."""
    columns: list[list[float]] = []
    for index in range(inputs):
        given = [0.0] * inputs
        given[index] = SMALL
        columns.append(step(given))
    found = np.array(columns).T / SMALL
    found.setflags(write=False)
    return found


def law_matrix(law: Law, assumed_mN_per_um: float = 0.0) -> Array:
    """Return the matrix of ``law.step``: (x in µm, F in mN, u_{k-1} in V, state) to (u_k, state).

    Its shape is (1 + n, 3 + n) with n floats of state, and u_k is in V. If the law has a
    ``linearise`` function, that is used; it may order the n states differently.
    ``assumed_mN_per_um`` is the contact stiffness that a law with ``previews`` assumes; 0: no
    contact.
    """
    if law.definition.linearise is not None:
        return law.definition.linearise(law)
    template = control_law.start(law, x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0)
    plan = PlannedMotion(K_e_mN_per_um=assumed_mN_per_um)

    def step(given: list[float]) -> list[float]:
        x_um, force_mN, applied_V, *state = given
        after, output = control_law.step(
            law,
            refill(template, iter(state)),
            x_um=x_um,
            force_mN=force_mN,
            applied_V=applied_V,
            x_r_um=0.0,
            force_r_mN=0.0,
            limited=0,
            plan=plan,
        )
        return [output.voltage_V, *flatten(after)]

    return matrix_of(step, 3 + len(flatten(template)))


@lru_cache(maxsize=256)
def law_block(
    settings: LawSettings,
    arm: ArmParameters,
    period_s: float,
    force_filter_s: float,
    output: OutputTiming = PROMPT,
    assumed_mN_per_um: float = 0.0,
) -> Array:
    """Return ``law_matrix`` of a law; arguments and exceptions are those of ``law.build``.

    A law with the identified set inverts its model of the free response. The loop is then equal to
    that with a straight line, and ``LoopCase.gain_factor`` represents the slope error of H.
    """
    if settings.set == "identified":
        settings = replace(settings, set="consistent")
    law = control_law.build(settings, arm, period_s, force_filter_s, output=output)
    return law_matrix(law, assumed_mN_per_um)


@lru_cache(maxsize=64)
def observer_block(observer: ForceObserver) -> Array:
    """Return the matrix of ``observe``: (x, x_1 in µm, u_{k-1} in V, state) to (F̂ in mN, state).

    Its shape is (1 + n, 3 + n) with n floats of state.
    """

    def step(given: list[float]) -> list[float]:
        x_um, free_um, voltage_V, *state = given
        after, force_mN = with_state(observer, tuple(state)).observe(x_um, free_um, voltage_V)
        return [force_mN, *state_of(after)]

    return matrix_of(step, 3 + len(state_of(observer)))


def loop_matrices(loop: Loop, cases: tuple[LoopCase, ...]) -> Array:
    """Return z_{k+1} = A z_k of every case with zero references, shape (cases, n, n).

    The states are (x, ẋ/ω_n in µm, y, u_{k-1} in V), then those of the observer and of the law.
    States that do not influence the position in any case are removed, and states that do not
    influence it in some cases are 0 there. An example is the integrator ε without a switching term.
    """
    found = _closed(loop, cases)
    acts = _acting(found)
    found = np.where(acts[:, :, None] & acts[:, None, :], found, 0.0)
    kept = np.any(acts, axis=0)
    kept[:ARM_STATES] = True
    return found[:, kept][:, :, kept]


def assumed_stiffness(loop: Loop, cases: tuple[LoopCase, ...]) -> Array:
    """Return the contact stiffness that the law assumes in each case, in mN/µm; 0 if irrelevant."""
    previews = loop.law.definition.previews
    return np.array([case.assumed_stiffness if previews else 0.0 for case in cases])


@lru_cache(maxsize=256)
def controller_block(loop: Loop, assumed_mN_per_um: float = 0.0) -> tuple[Array, Array]:
    """Return the matrix (F, x, u_{k-1}, observer, law) to (u_k, observer, law), and the row of F̂.

    The law's row for F is separate, since its force input depends on the case.
    """
    arm = loop.arm
    observer = loop.observer
    if observer is None:
        observer = QuasiStatic(QuasiStaticParameters(1.0 / arm.k))
    watch = observer_block(observer)
    law = law_block(
        loop.law, arm, loop.period_s, loop.force_filter_s, loop.assumed_timing, assumed_mN_per_um
    )
    seen, kept = watch.shape[0] - 1, law.shape[0] - 1
    size = 3 + seen + kept
    # Inputs of the observer: x, x_1 = d_p·u_{k-1}, u_{k-1}, its state.
    feed = np.zeros((3 + seen, size))
    feed[0, 1], feed[1, 2], feed[2, 2] = 1.0, arm.d / arm.k, 1.0
    feed[3:, 3 : 3 + seen] = np.eye(seen)
    watched = watch @ feed
    found = np.zeros((1 + seen + kept, size))
    found[1 : 1 + seen] = watched[1:]
    # The law's columns are x, F, u_{k-1}, state; its rows are u_k, state.
    inputs = np.zeros((law.shape[1], size))
    inputs[0, 1] = inputs[1, 0] = inputs[2, 2] = 1.0
    inputs[3:, 3 + seen :] = np.eye(kept)
    made = law @ inputs
    found[0], found[1 + seen :] = made[0], made[1:]
    return found, watched[0]


def _closed(loop: Loop, cases: tuple[LoopCase, ...]) -> Array:
    assumed = assumed_stiffness(loop, cases)
    found: Array | None = None
    for value in dict.fromkeys(assumed.tolist()):
        places = np.nonzero(assumed == value)[0]
        some = _closed_with(loop, tuple(cases[place] for place in places), value)
        if found is None:
            found = np.zeros((len(cases), *some.shape[1:]))
        found[places] = some
    return np.zeros((0, ARM_STATES, ARM_STATES)) if found is None else found


def _closed_with(loop: Loop, cases: tuple[LoopCase, ...], assumed_mN_per_um: float) -> Array:
    controller, reading = controller_block(loop, assumed_mN_per_um)
    transition, drive = sampled_arms(loop.arm, loop.period_s, loop.output_lag_s, cases)
    rest = controller.shape[0] - 1
    size = ARM_STATES + rest
    # Inputs of the controller from the states of each case: F, x, u_{k-1}, observer and law.
    feed = np.zeros((len(cases), controller.shape[1], size))
    feed[:, 1, X] = feed[:, 2, VOLTAGE] = 1.0
    feed[:, 3:, ARM_STATES:] = np.eye(rest)
    stiffness = np.array([case.K_e_mN_per_um for case in cases])
    if loop.force == "true":
        feed[:, 0, X] = stiffness
    else:
        acts = np.array([case.assumed_stiffness > 0.0 for case in cases]) | loop.force_when_free
        feed[:, 0, :] = np.where(acts[:, None], reading @ feed, 0.0)
    made = controller @ feed
    found = np.zeros((len(cases), size, size))
    found[:, :ARM_STATES] = drive[:, :, None] * made[:, :1]
    found[:, :ARM_STATES, :ARM_STATES] += transition
    found[:, ARM_STATES:] = made[:, 1:]
    return found


def _acting(matrices: Array) -> npt.NDArray[np.bool_]:
    """Return which states influence the position, directly or indirectly; shape (cases, n)."""
    reads = matrices != 0.0
    acts = np.zeros(matrices.shape[:2], dtype=bool)
    acts[:, X] = True
    while True:
        more = acts | np.any(reads & acts[:, :, None], axis=1)
        if np.array_equal(more, acts):
            return acts
        acts = more
