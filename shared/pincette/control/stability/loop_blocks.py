"""The law and the force observer as matrices, read off the code that runs each tick.

With references at zero, inside the boundary layer and off every limit, a step is linear in what it
is fed and in its state. Column j of its matrix is what the step makes of a small j-th input.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from pincette.control.arm.plant import ArmParameters
from pincette.control.force.observers import ForceObserver, state_of, with_state
from pincette.control.laws import law as control_law
from pincette.control.laws.law import LawSettings

Array = npt.NDArray[np.float64]
Value = TypeVar("Value")

SMALL = 2.0**-200
"""Size of an input: inside any boundary layer, and a power of two, so that it scales exactly."""


def flatten(state: Any) -> list[float]:
    """Return the floats of a float or of nested dataclasses, in the order of their fields.

    Raises
    ------
    TypeError
        Where something else is among them, which no matrix can follow.
    """
    if isinstance(state, float):
        return [state]
    if not is_dataclass(state) or isinstance(state, type):
        raise TypeError(f"a loop's state is made of floats, not of {type(state).__name__}")
    found: list[float] = []
    for field in fields(state):
        found += flatten(getattr(state, field.name))
    return found


def refill(template: Value, values: Iterator[float]) -> Value:
    """Return the template with other floats; the inverse of ``flatten``."""
    whole: Any = template
    if isinstance(whole, float):
        found: Any = next(values)
        return found
    return type(whole)(*(refill(getattr(whole, field.name), values) for field in fields(whole)))


def matrix_of(step: Callable[[list[float]], list[float]], inputs: int) -> Array:
    """Matrix of a linear step that takes ``inputs`` numbers, shape (outputs, inputs)."""
    columns: list[list[float]] = []
    for index in range(inputs):
        fed = [0.0] * inputs
        fed[index] = SMALL
        columns.append(step(fed))
    found = np.array(columns).T / SMALL
    found.setflags(write=False)
    return found


@lru_cache(maxsize=256)
def law_block(
    settings: LawSettings, arm: ArmParameters, period_s: float, force_filter_s: float
) -> Array:
    """Matrix of ``law.step``: from (x in µm, F in mN, u_{k-1} in V, state) to (u_k in V, state).

    Shape (1 + n, 3 + n) with n floats of state. Arguments and exceptions are those of
    ``law.build``.
    """
    law = control_law.build(settings, arm, period_s, force_filter_s)
    template = control_law.start(law, x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0)

    def step(fed: list[float]) -> list[float]:
        x_um, force_mN, applied_V, *state = fed
        after, output = control_law.step(
            law,
            refill(template, iter(state)),
            x_um=x_um,
            force_mN=force_mN,
            applied_V=applied_V,
            x_r_um=0.0,
            force_r_mN=0.0,
            limited=0,
        )
        return [output.voltage_V, *flatten(after)]

    return matrix_of(step, 3 + len(flatten(template)))


@lru_cache(maxsize=64)
def observer_block(observer: ForceObserver) -> Array:
    """Matrix of ``observe``: from (x, x_1 in µm, u_{k-1} in V, state) to (F̂ in mN, state).

    Shape (1 + n, 3 + n) with n floats of state.
    """

    def step(fed: list[float]) -> list[float]:
        x_um, free_um, voltage_V, *state = fed
        after, force_mN = with_state(observer, tuple(state)).observe(x_um, free_um, voltage_V)
        return [force_mN, *state_of(after)]

    return matrix_of(step, 3 + len(state_of(observer)))
