"""Stability of the law for two arms on a pair of arms, assessed by its worst case.

The closed loop is exact from sample to sample: both arms with their modes are free, hold a part
together, or one of them alone presses a fixed part. The matrix of the law is derived from its step.
If the law is informed of the true contact, a disturbance must decay within the limit for the
period; if the period is short compared with that of the mode, the largest singular value of the
sensitivity between positions must also stay below the limit of M_s. Until a contact or its loss is
detected, the law is not informed, and no disturbance may double in that time. For example, arms
that have lost their part but still have a force reference close on each other, faster if the real
slope of the response exceeds the identified one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import inf
from typing import Literal

import numpy as np
import numpy.typing as npt

from pincette.control.arm.plant import PROMPT, ArmParameters, OutputTiming
from pincette.control.arm.sampled_arm import exponential
from pincette.control.force.observers import least_period_s
from pincette.control.laws import two_arms
from pincette.control.laws.definition import Array
from pincette.control.laws.fpbsmic import Cascade
from pincette.control.laws.two_arms import Pair, TwoArmReferences, TwoArmState
from pincette.control.stability.limits import LIMIT_PEAK, limit_radius_at
from pincette.control.stability.sensitivity import angles

Complex = npt.NDArray[np.complex128]
Contact = Literal["free", "held", "first"]
"""Neither arm touches the part, both hold it, or the first arm alone presses it."""
STATE = 12
"""Number of varying floats in the law's state: H and x̄ of the previous sample, and eight filter
stages."""
LEAST_PART_UM_PER_MN = 0.005
"""Compliance c, in µm/mN, below which a part counts as rigid; nothing between two arms is
stiffer."""
PLACES = 6
"""Number of the arms' states: x_1, x_2, their speeds over ω, and both lagged voltages as
displacements."""
FOUND_S = 0.1
"""Time within which a contact or its loss is detected, in s: five samples at 20 ms."""
BATCH = 64


@dataclass(frozen=True, slots=True)
class TwoArmLoop:
    """The law of two arms on an identified pair of arms."""

    arms: tuple[ArmParameters, ArmParameters]
    gains: tuple[tuple[str, float], ...]
    period_s: float
    part_um_per_mN: float
    """Compliance c of the part, in µm/mN."""
    output: OutputTiming = PROMPT
    """Timing of the voltages, as given to the law; its lag is assumed to be exact."""

    @property
    def short(self) -> bool:
        """Return whether the period is short compared with that of either arm's mode."""
        rates = [(arm.k / arm.m) ** 0.5 for arm in self.arms]
        return any(self.period_s < least_period_s(rate) for rate in rates)


@dataclass(frozen=True, slots=True)
class TwoArmCase:
    """Conditions of the loop."""

    contact: Contact
    assumes_pressed: bool
    frequency_factors: Pair = (1.0, 1.0)
    """Ratio of each arm's real ω_i to the identified one."""
    gain_factors: Pair = (1.0, 1.0)
    """Ratio of the real slope of each H_i to the identified one."""
    delay_periods: float = 0.0
    damping_factor: float = 1.0
    part_factor: float = 1.0
    """Ratio of the real stiffness of the part to 1/c."""

    @property
    def informed(self) -> bool:
        """Return whether the law is informed of the true contact."""
        return self.assumes_pressed == (self.contact == "held") and self.contact != "first"


@dataclass(frozen=True, slots=True)
class TwoArmAssessment:
    """The worst case of a loop, and whether the arms may move."""

    radius: float
    limit_radius: float
    case: TwoArmCase
    uninformed_radius: float
    """Spectral radius while the law is not informed of the contact; 1 means a steady motion."""
    limit_uninformed_radius: float
    sensitivity_peak: float
    limit_peak: float
    reason: str
    """Reason why the arms must not move; "" if they may."""


def assess_two_arms(loop: TwoArmLoop) -> TwoArmAssessment:
    """Assess a pair of arms; raises ValueError if the gains of the law are impossible."""
    cases = tuple(_cases(loop))
    radii = np.concatenate(
        [_radii(loop, cases[first : first + BATCH]) for first in range(0, len(cases), BATCH)]
    )
    informed = np.array([case.informed for case in cases])
    worst = int(np.argmax(np.where(informed, radii, 0.0)))
    limit, uninformed = (
        limit_radius_at(loop.period_s),
        float(np.max(np.where(informed, 0.0, radii))),
    )
    limit_uninformed = 2.0 ** (loop.period_s / FOUND_S)
    radius, limit_peak, peak = float(radii[worst]), LIMIT_PEAK if loop.short else inf, inf
    if radius < 1.0:
        peak = _peak(loop, tuple(case for case in cases if case.informed))
    why = ""
    if not radius < limit:
        fault = "is unstable" if radius >= 1.0 else "settles too slowly"
        why = f"{fault}: spectral radius {radius:.4g}, limit {limit:.4g}"
    elif not uninformed <= limit_uninformed:
        why = "grows too fast until a touch or a loss is found: spectral radius "
        why += f"{uninformed:.4g}, limit {limit_uninformed:.4g}"
    elif not peak <= limit_peak:
        why = f"is too near to instability: peak of sensitivity {peak:.3g}, limit {limit_peak:g}"
    if why:
        at = f" at T = {1e3 * loop.period_s:g} ms; lower f_q or f_F"
        why = "two arms: the loop " + why + at
    return TwoArmAssessment(
        radius, limit, cases[worst], uninformed, limit_uninformed, peak, limit_peak, why
    )


def loop_matrices(loop: TwoArmLoop, cases: tuple[TwoArmCase, ...]) -> Array:
    """Return the transition of arms, law and previous voltages, shape (cases, n, n)."""
    transition, drive = sampled_pair(loop, cases)
    size = PLACES + 2 + STATE
    found = np.zeros((len(cases), size, size))
    found[:, :PLACES, : PLACES + 2] = transition
    for place, case in enumerate(cases):
        law = law_matrix(loop, pressed=case.assumes_pressed)
        seen = np.zeros((2 + STATE, size))
        seen[:, :2] = law[:, :2]
        seen[:, PLACES:] = law[:, 2:]
        found[place, :PLACES] += drive[place] @ seen[:2]
        found[place, PLACES:] = seen
    return found


def law_matrix(loop: TwoArmLoop, *, pressed: bool) -> Array:
    """Return the law's matrix: (x_1, x_2, X_1, X_2 of k-1, state) to (X_1, X_2 of k, state).

    Both estimators are quasi-static, and pair x with the displacement of ``two_arms.aged``, as the
    law does.
    """
    made = two_arms.build(
        loop.arms, dict(loop.gains), loop.period_s, loop.part_um_per_mN, loop.output
    )
    s_1, s_2 = made.compliances_um_per_mN
    references = TwoArmReferences(place_um=0.0, pressed=pressed)
    columns: list[list[float]] = []
    for unit in np.eye(4 + STATE).tolist():
        x_1, x_2, free_1, free_2, *rest = unit
        state = _state(rest, pressed=pressed)
        bar_1, bar_2 = two_arms.aged(made, state, (free_1, free_2))
        after, output = two_arms.step(
            made,
            state,
            tips_um=(x_1, x_2),
            free_um=(free_1, free_2),
            forces_mN=((bar_1 - x_1) / s_1, (bar_2 - x_2) / s_2),
            references=references,
        )
        columns.append([*output.free_um, *_floats(after)])
    return np.array(columns).T


def _radii(loop: TwoArmLoop, cases: tuple[TwoArmCase, ...]) -> Array:
    modes = np.linalg.eigvals(loop_matrices(loop, cases))
    return np.max(np.abs(modes), axis=1)


def _peak(loop: TwoArmLoop, cases: tuple[TwoArmCase, ...]) -> float:
    """Return the largest singular value of S = (1 - P·C)⁻¹ between positions, over all cases."""
    z: Complex = np.exp(1j * angles()).astype(np.complex128)[:, None, None]
    highest = 0.0
    for pressed in (False, True):
        some = tuple(case for case in cases if case.assumes_pressed == pressed)
        control = _law_response(loop, z, pressed=pressed)
        for first in range(0, len(some), BATCH):
            transition, drive = sampled_pair(loop, some[first : first + BATCH])
            inner = transition[:, None, :, :PLACES]
            driven = drive[:, None] + transition[:, None, :, PLACES:] / z
            solved = np.linalg.solve(z * np.eye(PLACES) - inner, driven).astype(np.complex128)
            across = np.linalg.inv(np.eye(2) - solved[:, :, :2] @ control)
            highest = max(highest, float(np.max(np.linalg.norm(across, 2, axis=(2, 3)))))
    return highest


def _law_response(loop: TwoArmLoop, z: Complex, *, pressed: bool) -> Complex:
    """Return C at each z, from (x_1, x_2) to (X_1, X_2), shape (angles, 2, 2)."""
    law = law_matrix(loop, pressed=pressed)
    size = 2 + STATE
    # The law's inputs are positions, its previous outputs, and its state.
    given = np.broadcast_to(law[:, :2].astype(np.complex128), (len(z), size, 2))
    solved = np.linalg.solve(np.eye(size) - law[:, 2:] / z, given).astype(np.complex128)
    return solved[:, :2]


def sampled_pair(loop: TwoArmLoop, cases: tuple[TwoArmCase, ...]) -> tuple[Array, Array]:
    """Return the transition with X of k-1, (cases, 6, 8), and the effect of X, (cases, 6, 2)."""
    count, lag_s = len(cases), loop.output.lag_s
    rate = np.zeros((count, PLACES + 2, PLACES + 2))
    delay_s = loop.period_s * np.array([case.delay_periods for case in cases])
    for place, case in enumerate(cases):
        for index, arm in enumerate(loop.arms):
            omega_n = (arm.k / arm.m) ** 0.5
            omega = omega_n * case.frequency_factors[index]
            rate[place, index, 2 + index] = omega
            rate[place, 2 + index, index] = -omega
            damping = arm.b / arm.m / omega_n * omega * case.damping_factor
            rate[place, 2 + index, 2 + index] = -damping
            source = 4 + index if lag_s > 0.0 else PLACES + index
            rate[place, 2 + index, source] += omega * case.gain_factors[index]
            if lag_s > 0.0:
                rate[place, 4 + index, 4 + index] = -1.0 / lag_s
                rate[place, 4 + index, PLACES + index] = 1.0 / lag_s
            if case.contact == "held":
                c = max(loop.part_um_per_mN, LEAST_PART_UM_PER_MN) / case.part_factor
                rate[place, 2 + index, :2] -= omega / arm.k / c
            elif case.contact == "first" and index == 0:
                c = 0.5 * max(loop.part_um_per_mN, LEAST_PART_UM_PER_MN)
                rate[place, 2, 0] -= omega / arm.k / c
    before = exponential(rate * delay_s[:, None, None])
    after = exponential(rate * (loop.period_s - delay_s)[:, None, None])
    moved: npt.NDArray[np.float64] = after[:, :PLACES, :PLACES] @ before[:, :PLACES]
    driven: npt.NDArray[np.float64] = after[:, :PLACES, PLACES:]
    if lag_s == 0.0:
        # Without a lag there is no separate lagged voltage.
        moved[:, 4:], driven[:, 4:] = 0.0, 0.0
    return moved, driven


def _cases(loop: TwoArmLoop) -> Iterator[TwoArmCase]:
    """Yield a grid of cases; at a short period the intervals are as wide as for one arm."""
    if loop.short:
        shifts, apart = (0.8, 0.9, 1.0, 1.1, 1.2), (0.9, 1.0, 1.1)
        delays, damping = (0.3, 0.65, 1.0), 0.77
    else:
        # The phase of the mode over a period is decisive; the grid follows it.
        shifts = tuple(float(value) for value in np.linspace(0.95, 1.05, 9))
        apart, delays, damping = (0.95, 1.0, 1.05), (0.0, 0.25, 0.5), 1.0
    gains = ((0.7, 0.7), (1.2, 1.2), (0.7, 1.2))
    kinds: tuple[tuple[Contact, bool], ...] = (
        ("free", False),
        ("held", True),
        ("held", False),
        ("free", True),
        ("first", False),
    )
    for (contact, pressed), shift, other, delay, gain in product(
        kinds, shifts, apart, delays, gains
    ):
        for part in (0.5, 2.0) if contact == "held" else (1.0,):
            factors = shift, shift * other
            yield TwoArmCase(contact, pressed, factors, gain, delay, damping, part)


def _state(values: list[float], *, pressed: bool) -> TwoArmState:
    older_1, older_2, lag_1, lag_2, *stages = values
    return TwoArmState(
        fresh=False,
        pressed=pressed,
        older_um=(older_1, older_2),
        lagging_um=(lag_1, lag_2),
        leads_um=(0.0, 0.0),
        force_r_mN=0.0,
        place_um=Cascade(*stages[:4]),
        sum_um=Cascade(*stages[4:]),
    )


def _floats(state: TwoArmState) -> list[float]:
    place, total = state.place_um, state.sum_um
    return [
        *state.older_um,
        *state.lagging_um,
        *(place.one, place.two, place.three, place.four),
        *(total.one, total.two, total.three, total.four),
    ]
