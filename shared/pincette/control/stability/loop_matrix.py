"""The closed loop as it runs, as one matrix a case: arm, force observer and law.

A tick takes the position, lets the observer find the force from it and from x_1 = d_p·u_{k-1}, lets
the law compute u_k, and puts that out. The arm is exact (``sampled_arm``); the other two are read
off their code (``loop_blocks``), switching slope K_S/δ included. What no one reads is left out.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from pincette.control.arm.plant import ArmParameters
from pincette.control.checks import require_not_negative, require_positive
from pincette.control.force.observers import ForceObserver, QuasiStatic, QuasiStaticParameters
from pincette.control.laws.law import LawSettings
from pincette.control.stability.loop_blocks import Array, law_block, observer_block
from pincette.control.stability.sampled_arm import LoopCase, sampled_arms

FedForce = Literal["estimated", "true"]
ARM_STATES = 4
X, VOLTAGE = 0, 3
"""Where x and u_{k-1} stand among the states."""


@dataclass(frozen=True, slots=True)
class Loop:
    """A law as it runs on a rig.

    Raises
    ------
    ValueError
        Where the period is not positive or a time constant negative.
    """

    law: LawSettings
    arm: ArmParameters
    """The rig's, as identified: the law's and the estimator's model, unless the law has its own."""
    period_s: float
    force_filter_s: float = 0.0
    """Time constant of the low-pass over F - F_r, which acts with planned forces."""
    output_lag_s: float = 0.0
    """First-order lag between output and arm."""
    force: FedForce = "estimated"
    """``true`` feeds the law K_e·x instead of the observer's force."""
    observer: ForceObserver | None = None
    """None: the quasi-static one."""
    fed_force: bool = False
    """Whether the law is fed the force of the free arm, too, instead of F = F_r = 0."""

    def __post_init__(self) -> None:
        require_positive("period", self.period_s, "s")
        require_not_negative("force filter", self.force_filter_s, "s")
        require_not_negative("output lag", self.output_lag_s, "s")

    def with_law(self, **changes: float) -> "Loop":
        """Return the loop with other gains."""
        return replace(self, law=replace(self.law, **changes))


def loop_matrices(loop: Loop, cases: tuple[LoopCase, ...]) -> Array:
    """z_{k+1} = A z_k of every case, references at zero; shape (cases, n, n).

    The states are (x, ẋ/ω_n in µm, y, u_{k-1} in V), the observer's, the law's. Those that reach
    the position in no case are dropped, and they are 0 in the cases in which they do not reach it:
    such is ε without a switching term, an integrator nobody reads.
    """
    found = _closed(loop, cases)
    acts = _acting(found)
    found = np.where(acts[:, :, None] & acts[:, None, :], found, 0.0)
    kept = np.any(acts, axis=0)
    kept[:ARM_STATES] = True
    return found[:, kept][:, :, kept]


@lru_cache(maxsize=256)
def _controller(loop: Loop) -> tuple[Array, Array]:
    """From (F fed, x, u_{k-1}, observer, law) to (u_k, observer, law), and the row of F̂.

    The law's row for F stands apart, since what it is fed depends on the case.
    """
    arm = loop.arm
    observer = loop.observer
    if observer is None:
        observer = QuasiStatic(QuasiStaticParameters(1.0 / arm.k))
    watch = observer_block(observer)
    law = law_block(loop.law, arm, loop.period_s, loop.force_filter_s)
    seen, kept = watch.shape[0] - 1, law.shape[0] - 1
    size = 3 + seen + kept
    # What the observer is fed: x, x_1 = d_p·u_{k-1}, u_{k-1}, its state.
    feed = np.zeros((3 + seen, size))
    feed[0, 1], feed[1, 2], feed[2, 2] = 1.0, arm.d / arm.k, 1.0
    feed[3:, 3 : 3 + seen] = np.eye(seen)
    watched = watch @ feed
    found = np.zeros((1 + seen + kept, size))
    found[1 : 1 + seen] = watched[1:]
    # The law's columns are x, F, u_{k-1}, state; its rows are u_k, state.
    fed = np.zeros((law.shape[1], size))
    fed[0, 1] = fed[1, 0] = fed[2, 2] = 1.0
    fed[3:, 3 + seen :] = np.eye(kept)
    made = law @ fed
    found[0], found[1 + seen :] = made[0], made[1:]
    return found, watched[0]


def _closed(loop: Loop, cases: tuple[LoopCase, ...]) -> Array:
    controller, reading = _controller(loop)
    transition, drive = sampled_arms(loop.arm, loop.period_s, loop.output_lag_s, cases)
    rest = controller.shape[0] - 1
    size = ARM_STATES + rest
    # What the controller is fed, of each case's states: F, x, u_{k-1}, observer and law.
    feed = np.zeros((len(cases), controller.shape[1], size))
    feed[:, 1, X] = feed[:, 2, VOLTAGE] = 1.0
    feed[:, 3:, ARM_STATES:] = np.eye(rest)
    stiffness = np.array([case.K_e_mN_per_um for case in cases])
    if loop.force == "true":
        feed[:, 0, X] = stiffness
    else:
        fed = (stiffness > 0.0) | loop.fed_force
        feed[:, 0, :] = np.where(fed[:, None], reading @ feed, 0.0)
    made = controller @ feed
    found = np.zeros((len(cases), size, size))
    found[:, :ARM_STATES] = drive[:, :, None] * made[:, :1]
    found[:, :ARM_STATES, :ARM_STATES] += transition
    found[:, ARM_STATES:] = made[:, 1:]
    return found


def _acting(matrices: Array) -> npt.NDArray[np.bool_]:
    """Which states reach the position, at once or through others; shape (cases, n)."""
    reads = matrices != 0.0
    acts = np.zeros(matrices.shape[:2], dtype=bool)
    acts[:, X] = True
    while True:
        more = acts | np.any(reads & acts[:, :, None], axis=1)
        if np.array_equal(more, acts):
            return acts
        acts = more
