"""Modes of the arms, either apart or joined, in the same layout for all arms; pure.

Three modes w and six components of the state, in the order q_1, q_2, y, q̇_1, q̇_2, ẏ; components
that an arm lacks are 0.
"""

import math
from typing import NamedTuple

from pincette.sim.plant.modes import ModalSystem

Three = tuple[complex, complex, complex]
Components = tuple[float, float, float, float, float, float]
Rows = tuple[Three, Three, Three, Three, Three, Three]

NOTHING: Three = (0j, 0j, 0j)


class ArmModes(NamedTuple):
    """Modes of the arms, apart or joined; see ``ModalSystem``."""

    rates_per_s: Three
    into: Rows
    """Left vectors L, by component of the state."""
    out: Rows
    """Right vectors R, by component of the state."""
    rest_by_input: Components
    rest_by_offset: Components
    pushed_by_input: Three
    pushed_by_offset: Three
    tip: Three
    watched: Three
    most_watched: tuple[float, float, float]
    most_by_input: float


class Transition(NamedTuple):
    """Transition over a step: factors e^(µ_i·h), and φ_i·L_i·(r; 0)."""

    factors: Three
    pushes: Three


def arm_modes(system: ModalSystem, bending_modes: int) -> ArmModes:
    """Arrange a system of one or two bending modes, and of a passive arm if it has more modes."""
    count = len(system.rates_per_s)
    places = [0, 1, 2] if bending_modes == 2 else [0, 2]
    places = [*places[:count], *(3 + place for place in places[:count])]

    def rows(values: list[tuple[complex, ...]]) -> Rows:
        found = [NOTHING] * 6
        for place, value in zip(places, values, strict=True):
            found[place] = _three(value)
        return (found[0], found[1], found[2], found[3], found[4], found[5])

    def components(values: tuple[float, ...]) -> Components:
        found = [0.0] * 6
        for place, value in zip(places, values, strict=True):
            found[place] = value
        return (found[0], found[1], found[2], found[3], found[4], found[5])

    most = (*system.most_watched, 0.0, 0.0)
    return ArmModes(
        rates_per_s=_three(system.rates_per_s),
        into=rows(list(zip(*system.into, strict=True))),
        out=rows(list(system.out)),
        rest_by_input=components(system.rest_by_input),
        rest_by_offset=components(system.rest_by_offset),
        pushed_by_input=_three(system.pushed_by_input),
        pushed_by_offset=_three(system.pushed_by_offset),
        tip=_three(system.tip),
        watched=_three(system.watched),
        most_watched=(most[0], most[1], most[2]),
        most_by_input=system.most_by_input,
    )


def _three(values: tuple[complex, ...]) -> Three:
    first, second, third, *_ = (*values, 0j, 0j)
    return (first, second, third)


def modes_of(modes: ArmModes, state: Components, input_um: float, offset_um: float) -> Three:
    """Return the modes w of a state."""
    a, b, c = 0j, 0j, 0j
    for index in range(6):
        rest_um = modes.rest_by_input[index] * input_um
        apart = state[index] - rest_um - modes.rest_by_offset[index] * offset_um
        row = modes.into[index]
        a += row[0] * apart
        b += row[1] * apart
        c += row[2] * apart
    return (a, b, c)


def component(modes: ArmModes, index: int, w: Three, input_um: float, offset_um: float) -> float:
    """Return the component of the state that w represents."""
    rest = modes.rest_by_input[index] * input_um + modes.rest_by_offset[index] * offset_um
    return rest + deviation(modes.out[index], w)


def deviation(weights: Three, w: Three) -> float:
    """Return 2·Re Σ weights_i·w_i."""
    p, q, r = weights[0], weights[1], weights[2]
    a, b, c = w
    total = p.real * a.real - p.imag * a.imag
    total += q.real * b.real - q.imag * b.imag
    total += r.real * c.real - r.imag * c.imag
    return 2.0 * total


def magnitude(w: complex) -> float:
    """Return |w| of numbers whose squares do not overflow."""
    return math.sqrt(w.real * w.real + w.imag * w.imag)


def transition(modes: ArmModes, dt_s: float, lag_s: float) -> Transition:
    """Return the transition over a step.

    The input approaches its goal with time constant ``lag_s``.
    """
    if dt_s <= 0.0 < lag_s:
        return Transition((1.0 + 0j, 1.0 + 0j, 1.0 + 0j), (0j, 0j, 0j))
    rest = math.exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0
    share = -math.expm1(-dt_s / lag_s) if lag_s > 0.0 else 1.0
    rates, pushed = modes.rates_per_s, modes.pushed_by_input
    a, b, c = rates[0], rates[1], rates[2]
    e, f, g = exponential(a, dt_s), exponential(b, dt_s), exponential(c, dt_s)
    p, q, r = pushed[0], pushed[1], pushed[2]
    return Transition(
        (e, f, g),
        (
            p * (e - rest) / ((1.0 + a * lag_s) * share),
            q * (f - rest) / ((1.0 + b * lag_s) * share),
            r * (g - rest) / ((1.0 + c * lag_s) * share),
        ),
    )


def exponential(rate_per_s: complex, dt_s: float) -> complex:
    """Return e^(µ·h)."""
    grown, angle = math.exp(rate_per_s.real * dt_s), rate_per_s.imag * dt_s
    return complex(grown * math.cos(angle), grown * math.sin(angle))


def carried(step: Transition, w: Three, moved_um: float) -> Three:
    """Return w after a step during which x_f changes by ``moved_um``."""
    (e, f, g), (p, q, r) = step
    return (
        e * w[0] - p * moved_um,
        f * w[1] - q * moved_um,
        g * w[2] - r * moved_um,
    )
