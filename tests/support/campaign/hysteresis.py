"""Three classes of hysteresis, written for the campaign alone: relays, plays, and Bouc-Wen.

Nothing here is shared with the simulated plant of the product. Each class maps a voltage in V to a
motion in V of the same scale: ``y = (1 - share)·u + share·H(u)``, with H(u) close to u for large
swings, and keeps its memory over all calls.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Class = Literal["relays", "plays", "Bouc-Wen"]
CLASSES: tuple[Class, ...] = ("relays", "plays", "Bouc-Wen")
NODES = 16
WIDEST_V, TABLE_STEP_V = 5.0, 0.02
"""Range and step of the table of relays; between its entries the motion deviates by some nm."""
SCALED_V = 4.0
PLAYS = 16
WIDEST_SHARE = 0.93
"""Largest hysteretic share, as a multiple of that at which an arm would move against its
voltage."""
BISECTIONS = 18
REFERENCE_V = 1.0
"""Amplitude of the cycle for which the loop's width is stated: 2 V peak to peak."""
WORKING_V = (-0.5, 3.0)
"""Voltages between which the gain is stated."""
CYCLE_STEPS = 60


class Hysteresis(Protocol):
    """Memory of one arm."""

    share: float
    """Hysteretic share of the motion."""
    most_share: float
    """Return the share beyond which the arm moves against its voltage after a reversal."""

    def to(self, u_V: float) -> float:
        """Change the voltage to ``u_V`` and return the motion there."""
        ...


class RelayField:
    """Infinitely many relays, Gaussian in their mean and half-normal in their half width.

    A relay turns up where u rises beyond mean + half, and down where it falls below mean - half.
    Far from saturation, the spreads are several times the drive. The motion is scaled to that of
    the line between -4 and 4 V.

    The relays are integrated, not counted: 56 by 56 of them, spread over 15 V, would move the tip
    in steps of more than 1 µm, and no actuator does so. The memory of the field is its turning
    points (Everett's integral).
    """

    def __init__(self, mean_spread_V: float, half_spread_V: float) -> None:
        self._table = everett(mean_spread_V, half_spread_V)
        self.share, self.most_share = 0.0, 1.0
        self.scale_V = SCALED_V / self._between(-SCALED_V, SCALED_V)
        self.u_V, self.sum = 0.0, 0.0
        self.turns: list[tuple[float, float]] = []
        """Turning points of the voltage that are remembered, and the sum at each."""

    def to(self, u_V: float) -> float:
        if u_V != self.u_V:
            begin_V = self.turns[-1][0] if self.turns else 0.0
            if (u_V - self.u_V) * (self.u_V - begin_V) < 0.0:
                self.turns.append((self.u_V, self.sum))
            while self.turns and self._closes(u_V):
                del self.turns[-2:]
            self.u_V, self.sum = u_V, self._sum(u_V)
        return (1.0 - self.share) * u_V + self.share * self.scale_V * self.sum

    def _closes(self, u_V: float) -> bool:
        """Return whether the branch from the last turning point has closed its loop."""
        begin_V = self.turns[-1][0]
        end_V = self.turns[-2][0] if len(self.turns) > 1 else -begin_V
        return (u_V - end_V) * (end_V - begin_V) > 0.0

    def _sum(self, u_V: float) -> float:
        """Return the sum of the relays, each 1 or -1, on the branch from the last turning point."""
        if not self.turns:
            return math.copysign(self._between(-abs(u_V), abs(u_V)), u_V)
        begin_V, begin = self.turns[-1]
        turned = self._between(min(u_V, begin_V), max(u_V, begin_V))
        return begin + math.copysign(2.0 * turned, u_V - begin_V)

    def _between(self, low_V: float, high_V: float) -> float:
        """Return the share of the relays that turn down above ``low_V`` and up below ``high_V``."""
        at_low, at_high = [(u_V + WIDEST_V) / TABLE_STEP_V for u_V in (low_V, high_V)]
        i, j = int(at_low), int(at_high)
        p, q = at_low - i, at_high - j
        near, far = self._table[i], self._table[i + 1]
        return (1.0 - p) * (near[j] + q * (near[j + 1] - near[j])) + p * (
            far[j] + q * (far[j + 1] - far[j])
        )


@lru_cache(maxsize=1)
def everett(mean_spread_V: float, half_spread_V: float) -> list[list[float]]:
    """Tabulate the share of relays that turn down above a voltage and up below another.

    Rows are the lower voltage and columns the upper one, from ``-WIDEST_V`` to ``WIDEST_V``. A
    relay of half width h has its mean between low + h and high - h, which h integrates.
    """
    grid = np.linspace(-WIDEST_V, WIDEST_V, round(2.0 * WIDEST_V / TABLE_STEP_V) + 1)
    low, high = np.meshgrid(grid, grid, indexing="ij")
    longest = 0.5 * np.maximum(0.0, high - low)
    fine = np.linspace(-WIDEST_V, WIDEST_V, 4 * len(grid))
    normal = np.array([0.5 * math.erf(u_V / (math.sqrt(2.0) * mean_spread_V)) for u_V in fine])
    found = np.zeros_like(low)
    for node, weight in zip(*np.polynomial.legendre.leggauss(NODES), strict=True):
        half = 0.5 * (node + 1.0) * longest
        density = np.exp(-0.5 * (half / half_spread_V) ** 2)
        within = np.interp(high - half, fine, normal) - np.interp(low + half, fine, normal)
        found += weight * density * within
    return (found * longest / (half_spread_V * math.sqrt(2.0 * math.pi))).tolist()


class PlayStack:
    """Play operators of rising radius: y = sum of weights times the plays' outputs."""

    def __init__(self, widest_V: float, decay: float) -> None:
        self.radius: NDArray[np.float64] = np.linspace(0.04, 1.0, PLAYS) * widest_V
        weight = np.exp(-decay * np.linspace(0.0, 1.0, PLAYS))
        self.weight: NDArray[np.float64] = weight / weight.sum()
        self.state: NDArray[np.float64] = np.zeros(PLAYS)
        self.share, self.most_share = 0.0, 1.0

    def to(self, u_V: float) -> float:
        lowest, highest = u_V - self.radius, u_V + self.radius
        self.state = np.minimum(np.maximum(self.state, lowest), highest)
        return (1.0 - self.share) * u_V + self.share * float(self.weight @ self.state)


class BoucWen:
    """dh = du·(1 - (b·sign(du·h) + g)·|h|): h is the elastic part that is not given as motion."""

    LONGEST_V = 0.02

    def __init__(self, b_per_V: float, g_per_V: float) -> None:
        self.b_per_V, self.g_per_V = b_per_V, g_per_V
        self.h_V = self.u_V = 0.0
        self.share = 0.0
        # |h| < 1/(b + g), and dh/du = 1 + (b - g)·|h| as the voltage turns.
        self.most_share = (b_per_V + g_per_V) / (2.0 * b_per_V)

    def to(self, u_V: float) -> float:
        way_V = u_V - self.u_V
        steps = int(abs(way_V) / self.LONGEST_V) + 1
        for _ in range(steps if way_V else 0):
            du_V = way_V / steps
            sign = 1.0 if du_V * self.h_V > 0.0 else -1.0
            slope = 1.0 - (self.b_per_V * sign + self.g_per_V) * abs(self.h_V)
            self.h_V += du_V * slope
        self.u_V = u_V
        return u_V - self.share * self.h_V


def _shape(kind: Class, chance: np.random.Generator, *, far: bool) -> Hysteresis:
    if kind == "relays":
        low_V, high_V = (3.0, 6.0) if far else (0.8, 2.0)
        return RelayField(
            float(chance.uniform(low_V, high_V)), float(chance.uniform(low_V, high_V))
        )
    if kind == "plays":
        return PlayStack(float(chance.uniform(1.0, 3.0)), float(chance.uniform(0.0, 3.0)))
    b = float(chance.uniform(0.6, 1.6))
    return BoucWen(b, float(chance.uniform(-0.4, 0.4)) * b)


def cycle(low_V: float, high_V: float) -> Sequence[float]:
    """Return the voltages of one cycle from the bottom over the top to the bottom."""
    turn = np.linspace(0.0, 2.0 * np.pi, CYCLE_STEPS, endpoint=False)
    middle, half = 0.5 * (low_V + high_V), 0.5 * (high_V - low_V)
    return [float(u) for u in middle - half * np.cos(turn)]


def loop(hysteresis: Hysteresis) -> tuple[float, float]:
    """Return the stroke of a settled cycle at ``REFERENCE_V``, and its width as a share of the
    stroke."""
    voltages = cycle(-REFERENCE_V, REFERENCE_V)
    motion: list[float] = []
    for _ in range(3):
        motion = [hysteresis.to(u) for u in voltages]
    half = CYCLE_STEPS // 2
    rising, falling = motion[: half + 1], [*motion[half:], motion[0]][::-1]
    stroke = motion[half] - motion[0]
    return stroke, max(f - r for f, r in zip(falling, rising, strict=True)) / stroke


def drawn(
    kind: Class, loop_share: float, chance: np.random.Generator, *, far: bool
) -> tuple[Hysteresis, float, float]:
    """Draw an arm whose loop is as wide as ``loop_share``, or as wide as its class can be made.

    Returns the unpoled arm, its stroke over the working range, and the width of its loop.
    """
    seed = int(chance.integers(2**32))

    def made(share: float) -> Hysteresis:
        shape = _shape(kind, np.random.default_rng(seed), far=far)
        shape.share = share
        return shape

    low, high = 0.0, WIDEST_SHARE * made(0.0).most_share
    if loop(made(high))[1] > loop_share:
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if loop(made(middle))[1] < loop_share:
                low = middle
            else:
                high = middle
    arm = made(high)
    working = [arm.to(u) for u in (*WORKING_V, *WORKING_V)]
    return made(high), working[-1] - working[-2], loop(made(high))[1]
