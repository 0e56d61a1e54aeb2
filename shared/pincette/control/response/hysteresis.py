"""Hysteresis and creep of a piezoelectric arm: Prandtl-Ishlinskii operator and linear creep.

With u in V, the displacement in µm, and thresholds r_i, while the voltage rises or falls
monotonically by |Δu|:

    play           z_i = u - y_i;   dz_i/du = 1 - λ_i·z_i·sign(du)  within  |z_i| ≤ r_i,
                   and  dz_i/du = 1 - μ_i·z_i·sign(du)  while |z_i| falls
    static         y = q·u² + Σ [w_i·y_i + g_i(y_i)],  r_0 = 0 being the linear part
    bend           g_i(y) = a_i·y² + b_i·y³ between two voltages, straight beyond them
    creep          τ_j·ċ_j = y - c_j
    displacement   y + Σ κ_j·c_j

Without fading, λ_i = 0, these are the play operators of Prandtl and Ishlinskii, y_i ← max(u - r_i,
min(u + r_i, y_i)), which return to their previous state after a small loop. With fading, a play
that does not yield loses its memory by e^(-λ_i·|Δu|) as the voltage changes, so that small loops
erase the memory of large ones, and each loop begins with a different slope (accommodation). A play
with r_i·λ_i ≥ 1 never yields: its z tends to 1/λ_i. Such a play is the Dahl operator; with a
separate rate μ_i while z returns to 0 it is the Bouc-Wen operator, whose b and g are (λ + μ)/2 and
(λ - μ)/2. The curvature q has the same effect on rising and falling branches. Loops of plays
without the functions g_i, the bends, are equally wide at every voltage. With them the width depends
on the voltage: a Preisach operator of any density is a sum of functions g_i of plays.

The plays depend on the path of the voltage alone, not on its speed; the creep states are linear.
Sources: M. Brokate and J. Sprekels, Hysteresis and Phase Transitions, Springer 1996, chapter 2;
K. Kuhnen, European Journal of Control 9(4), 2003, for the operator with creep in an actuator;
E. Della Torre, IEEE Transactions on Magnetics 30(5), 1994, for accommodation;
P. Krejčí, Hysteresis, Convexity and Dissipation in Hyperbolic Equations, Gakkōtosho 1996, section
II.3, for the Preisach operator by plays.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import count, pairwise, repeat
from math import copysign, exp, expm1, isfinite, log1p
from typing import NamedTuple

from pincette.control.checks import require_not_negative, require_positive
from pincette.control.record import FrozenRecord

ROUNDED = 1e-2
"""Tolerance for rounded numbers in a file: fraction by which r·λ of a play that never yields may be
less than 1."""


@dataclass(frozen=True, slots=True)
class HysteresisModel:
    """Coefficients of the operator. The first threshold is 0 and belongs to the linear part.

    Plays with equal thresholds may differ in their fading.

    Raises
    ------
    ValueError
        If lengths disagree, a number is not finite, the first threshold is not 0 or another is
        not positive, a play occurs twice, a time is not positive, a fading is negative, or the
        displacement would, but for its curvature, fall on a branch
        of rising voltage.
    """

    thresholds_V: tuple[float, ...]
    """Threshold r_i of each play, in V."""
    weights_um_per_V: tuple[float, ...]
    """Weight w_i of each play, in µm/V."""
    creep_times_s: tuple[float, ...] = ()
    """Time constant τ_j of each creep state, in s."""
    creep_fractions: tuple[float, ...] = ()
    """Amplitude κ_j of each creep state, as a fraction of the static displacement."""
    fadings_per_V: tuple[float, ...] = ()
    """Fading λ_i of each play, in 1/V; empty if no play fades. The fading of the linear part, which
    has no memory, is 0."""
    curvature_um_per_V2: float = 0.0
    """Curvature q, in µm/V²."""
    squares_um_per_V2: tuple[float, ...] = ()
    """Coefficient a_i of each bend, in µm/V²; empty without bends."""
    cubes_um_per_V3: tuple[float, ...] = ()
    """Coefficient b_i of each bend, in µm/V³; empty without bends."""
    bent_V: tuple[float, float] = (0.0, 0.0)
    """Range of a play's value in which the bends are polynomials, in V; they are straight beyond
    it."""
    return_fadings_per_V: tuple[float, ...] = ()
    """Fading μ_i of each play while |z_i| falls, in 1/V; empty if it equals λ_i."""

    def __post_init__(self) -> None:
        _require_same("weights_um_per_V", self.weights_um_per_V, "thresholds_V", self.thresholds_V)
        _require_same("creep_fractions", self.creep_fractions, "creep_times_s", self.creep_times_s)
        if self.fadings_per_V:
            _require_same("fadings_per_V", self.fadings_per_V, "thresholds_V", self.thresholds_V)
        if not self.thresholds_V or self.thresholds_V[0] != 0.0:
            raise ValueError(f"thresholds_V = {self.thresholds_V} V, the first must be 0 V")
        fadings = self.fadings_per_V or (0.0,) * len(self.thresholds_V)
        returns = self.return_fadings_per_V or fadings
        _require_same("return_fadings_per_V", returns, "thresholds_V", self.thresholds_V)
        _require_possible(
            [
                _Play(*values)
                for values in zip(
                    self.thresholds_V, fadings, returns, self.weights_um_per_V, strict=True
                )
            ]
        )
        if not isfinite(self.curvature_um_per_V2):
            raise ValueError(f"curvature {self.curvature_um_per_V2} µm/V², must be finite")
        if self.squares_um_per_V2 or self.cubes_um_per_V3:
            _require_bends(self)
        for time_s in self.creep_times_s:
            require_positive("creep time", time_s, "s")
        for fraction in self.creep_fractions:
            if not isfinite(fraction):
                raise ValueError(f"creep fraction {fraction}, must be finite")


class HysteresisState(FrozenRecord, frozen=True):
    """Memory of the actuator."""

    voltage_V: float
    plays_V: tuple[float, ...]
    static_um: float
    creep_um: tuple[float, ...]
    """Creep states c_j before multiplication by their fractions, in µm."""


def start(model: HysteresisModel) -> HysteresisState:
    """Return the memory of an unpoled actuator, at 0 V and 0 µm."""
    plays = (0.0,) * len(model.thresholds_V)
    return HysteresisState(0.0, plays, 0.0, (0.0,) * len(model.creep_times_s))


def step(
    model: HysteresisModel, state: HysteresisState, voltage_V: float, dt_s: float
) -> HysteresisState:
    """Return the memory after a monotonic change to ``voltage_V``, held for ``dt_s``.

    A change du of the voltage between the thresholds, in one or several parts, changes z to

        z·e^(-λ·|du|) + sign(du)·(1 - e^(-λ·|du|))/λ

    with μ in place of λ up to z = 0 where |z| falls.
    """
    plays, static_um = _yielded(model, state, voltage_V)
    factors = creep_factors(model.creep_times_s, dt_s)
    creep = tuple(
        [static_um + (c - static_um) * a for c, a in zip(state.creep_um, factors, strict=True)]
    )
    return HysteresisState(voltage_V, tuple(plays), static_um, creep)


def _yielded(
    model: HysteresisModel, state: HysteresisState, u: float
) -> tuple[Sequence[float], float]:
    """Return the plays, and the static displacement, after a monotonic change of the voltage."""
    plays, before = state.plays_V, state.voltage_V
    if u == before:
        return plays, state.static_um
    sign = -1.0 if u > before else 1.0
    back_V = sign * (u - before)
    moved = list(plays)
    static_um = model.curvature_um_per_V2 * u * u
    fadings = model.fadings_per_V or repeat(0.0)
    returns = model.return_fadings_per_V or fadings
    # Most of the time of a tick is spent in this loop, so it uses few names and few calls. ``zip``
    # is not strict, since the zeros of plays without fading are an endless iterator.
    for place, r, w, y, fading, returning in zip(
        count(), model.thresholds_V, model.weights_um_per_V, plays, fadings, returns, strict=False
    ):
        if y == before + sign * r:  # The play yields already, and continues to do so.
            play = u + sign * r
        elif fading:
            z, way_V = before - y, back_V
            if returning != fading and z * sign > 0.0:
                z, way_V = _returned(z, returning, back_V)
            lost = expm1(fading * way_V)
            z = z * (1.0 + lost) + sign * lost / fading
            if z >= r:
                z = r
            elif z <= -r:
                z = -r
            play = u - z
        elif y <= u - r:
            play = u - r
        elif y >= u + r:
            play = u + r
        else:
            play = y
        moved[place] = play
        static_um += w * play
    if model.squares_um_per_V2:
        static_um += _bends_um(model, moved)
    return moved, static_um


def _returned(z_V: float, returning_per_V: float, back_V: float) -> tuple[float, float]:
    """Return z after the part of a voltage change that reduces |z|, and the remaining change.

    d|z| = -(1 + μ·|z|)·|du| until z = 0. The changes of the voltage, ``back_V`` and the returned
    one, are given as negative numbers.
    """
    height_V = abs(z_V)
    to_zero_V = log1p(returning_per_V * height_V) / returning_per_V if returning_per_V else height_V
    if to_zero_V < -back_V:
        return 0.0, back_V + to_zero_V
    lost = expm1(returning_per_V * back_V)
    fell_V = -lost / returning_per_V if returning_per_V else -back_V
    return copysign(max(0.0, height_V * (1.0 + lost) - fell_V), z_V), 0.0


def _bends_um(model: HysteresisModel, plays_V: Sequence[float]) -> float:
    """Return the sum of the bends, Σ g_i(y_i), in µm."""
    low_V, high_V = model.bent_V
    total = 0.0
    for y, square, cube in zip(
        plays_V, model.squares_um_per_V2, model.cubes_um_per_V3, strict=True
    ):
        total += bend_um(square, cube, low_V, high_V, y)
    return total


def bend_um(square: float, cube: float, low_V: float, high_V: float, y: float) -> float:
    """Return g(y) = a·y² + b·y³ in µm between two voltages, and its tangent beyond them."""
    within = y if y < high_V else high_V
    within = within if within > low_V else low_V
    bent = (square + cube * within) * within * within
    if within != y:
        bent += (2.0 * square + 3.0 * cube * within) * within * (y - within)
    return bent


def displacements_after(
    model: HysteresisModel, state: HysteresisState, dt_s: float
) -> Callable[[float], float]:
    """Return a function from voltage to the displacement in µm after a ``step`` to that voltage."""
    factors = creep_factors(model.creep_times_s, dt_s)
    creep = list(zip(model.creep_fractions, state.creep_um, factors, strict=True))

    def displacement_at(voltage_V: float) -> float:
        _, static_um = _yielded(model, state, voltage_V)
        total = static_um
        for fraction, c, a in creep:
            total += fraction * (static_um + (c - static_um) * a)
        return total

    return displacement_at


def displacement_um(model: HysteresisModel, state: HysteresisState) -> float:
    """Return the free displacement y + Σ κ_j·c_j in µm."""
    total = state.static_um
    for fraction, creep in zip(model.creep_fractions, state.creep_um, strict=True):
        total += fraction * creep
    return total


@lru_cache(maxsize=64)
def creep_factors(creep_times_s: tuple[float, ...], dt_s: float) -> tuple[float, ...]:
    """Return the exact factors exp(-dt/τ_j), computed once for a model and a step."""
    return tuple([exp(-dt_s / time_s) for time_s in creep_times_s])


class _Play(NamedTuple):
    """Coefficients of one play, in the order used for sorting."""

    threshold_V: float
    fading_per_V: float
    return_fading_per_V: float
    weight_um_per_V: float


def _require_possible(plays: list[_Play]) -> None:
    """Check that an actuator with these plays is physically possible; raises ValueError."""
    linear = plays[0]
    for name, fading in (
        ("fading", linear.fading_per_V),
        ("return fading", linear.return_fading_per_V),
    ):
        if fading != 0.0:
            raise ValueError(f"{name} {fading} per V of the linear part, must be 0 per V")
    for threshold, fading, returning, _ in plays[1:]:
        require_positive("threshold", threshold, "V")
        require_not_negative("fading", fading, "per V")
        require_not_negative("return fading", returning, "per V")
        if returning != fading and not fading > 0.0:
            raise ValueError(f"return fading {returning} per V of a play that does not fade")
    ascending = sorted(plays)
    for before, play in pairwise(ascending):
        if before[:3] == play[:3]:
            raise ValueError(
                f"threshold {play.threshold_V} V with fading {play.fading_per_V} per V occurs twice"
            )
    # A rising voltage that has passed r_i moves all plays up to r_i, so its slope is their sum.
    slope = 0.0
    for play in ascending:
        slope += play.weight_um_per_V
        require_positive(f"slope up to {play.threshold_V} V", slope, "µm/V")
    # At a turning point all plays are at their thresholds, and fading reduces the slope. Plays that
    # never yield are not included: an arm with a wide Bouc-Wen loop continues to move for a moment
    # when its voltage turns.
    slope = linear.weight_um_per_V
    for threshold, fading, returning, weight in plays:
        if fading * threshold < 1.0 - ROUNDED:
            slope -= weight * returning * threshold
    require_positive("slope after a turn", slope, "µm/V")


def _require_bends(model: HysteresisModel) -> None:
    for name in ("squares_um_per_V2", "cubes_um_per_V3"):
        values: tuple[float, ...] = getattr(model, name)
        _require_same(name, values, "thresholds_V", model.thresholds_V)
        if not all(isfinite(value) for value in values):
            raise ValueError(f"{name} = {values}, all must be finite")
    low_V, high_V = model.bent_V
    if not low_V < high_V:
        raise ValueError(f"bent_V = ({low_V}, {high_V}) V, must be ascending")


def _require_same(
    name: str, values: tuple[float, ...], other: str, others: tuple[float, ...]
) -> None:
    if len(values) != len(others):
        raise ValueError(f"{len(values)} {name}, must be {len(others)}, the number of {other}")
