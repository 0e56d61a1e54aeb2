"""Gains by search: tracking of a law on the identified model, and the resulting Pareto front.

The paper tunes by trial and error. Here the actual law runs with each candidate on the identified
arm in contact, with the sensor's noise and a plan that has the error of the identified contact. The
trade-off is between position error and force error.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import sqrt

from pincette.control.arm.mode import Mode, sample_mode
from pincette.control.arm.plant import ArmParameters
from pincette.control.checks import require_positive
from pincette.control.laws import law as control_law
from pincette.control.laws.definition import LawDefinition, LawSettings
from pincette.control.laws.law import Law
from pincette.control.laws.parameters import ParameterSet
from pincette.control.response.free_response import FreeResponse
from pincette.control.response.hysteresis import HysteresisState
from pincette.control.response.identified_response import IdentifiedResponse

Grid = Mapping[str, Sequence[float]]
"""Values to try for each gain."""


@dataclass(frozen=True, slots=True)
class TuningRig:
    """The identified arm in contact, for the search."""

    arm: ArmParameters
    natural_frequency_rad_per_s: float
    damping_ratio: float
    response: FreeResponse
    """Free response at the voltage of first contact."""
    stiffness_mN_per_um: float
    """Stiffness K_e of the contact, in mN/µm."""
    stiffness_error: float
    """Largest relative error of the plan's K_e, in both directions."""
    force_error_mN: float
    """Error of the estimated force from the free response, in both directions, in mN."""
    noise_um: tuple[float, ...]
    """Sensor noise of each sample, in µm; at least as many samples as the path."""
    period_s: float
    delay_s: float
    """Delay from the sample until the voltage acts, in s."""
    force_filter_s: float
    slope_error: float = 0.0
    """Largest relative error of the response's slope, in both directions."""


@dataclass(frozen=True, slots=True)
class TuningPath:
    """Force references from the first contact, one per period, and index of the first evaluated
    one.
    """

    force_r_mN: tuple[float, ...]
    settled: int


@dataclass(frozen=True, slots=True)
class Candidate:
    """Gains, and the r.m.s. errors with them, in percent of the peak-to-peak value."""

    settings: LawSettings
    position_percent: float
    force_percent: float


@dataclass(frozen=True, slots=True)
class Tuning:
    """All candidates, those that no other one beats in both errors, and the balanced one."""

    candidates: tuple[Candidate, ...]
    """Candidates that remain at the end of the search.

    Only the radii of candidates on the Pareto front are computed. The search removes those at or
    above the limit and determines the front again, until all of the front are below the limit.
    """
    front: tuple[Candidate, ...]
    chosen: Candidate
    radius: float
    """Worst spectral radius of the chosen candidate."""


Sides = Sequence[tuple[float, float, float]]
"""Plans: their stiffness in mN/µm, the error of the estimated force in mN, and the ratio of the
free response's slope to that of its model."""
Tracked = Sequence[tuple[float, float]]
"""Errors of each candidate, r.m.s., in µm and mN."""


def tune(
    rig: TuningRig,
    path: TuningPath,
    definition: LawDefinition,
    radius: Callable[[LawSettings], float],
    *,
    radius_limit: float,
    grid: Grid | None = None,
    parameter_set: ParameterSet = "consistent",
) -> Tuning:
    """Search the gains of a law on a grid; other gains have their defaults.

    The balanced candidate is the one on the front whose larger error, in percent, is smallest.

    Parameters
    ----------
    radius
        Function that returns the worst spectral radius of a law over its intervals. If the radius
        is at or above the limit, any value at or above the limit may be returned.
    radius_limit
        Candidates with a radius at or above this limit are excluded.
    grid
        Values to try; None for the grid of the law.
    parameter_set
        Parameter set of the law; the identified one needs an ``IdentifiedResponse``.

    Raises
    ------
    ValueError
        If the path is shorter than its settling, the law has no grid, or no candidate is within the
        limit.
    """
    searched = dict(definition.search) if grid is None else grid
    if not searched:
        raise ValueError(f"{definition.title} has no tuning of gains: give each gain")
    start = definition.settings(parameter_set)
    laws = [
        start.with_gains(**dict(zip(searched, values, strict=True)))
        for values in product(*searched.values())
    ]
    sides = _sides(rig)
    left = [
        _candidate(rig, path, law, [track(rig, path, law, *side) for side in sides]) for law in laws
    ]
    radii: dict[LawSettings, float] = {}
    while left:
        front = pareto_front(left)
        # A radius costs far more than tracking, so it is computed for the front only.
        for item in front:
            if item.settings not in radii:
                radii[item.settings] = radius(item.settings)
        stable = [item for item in left if radii.get(item.settings, 0.0) < radius_limit]
        if len(stable) == len(left):
            chosen = min(front, key=lambda item: max(item.position_percent, item.force_percent))
            return Tuning(tuple(left), front, chosen, radii[chosen.settings])
        left = stable
    raise ValueError(
        f"no gains that were tried keep the spectral radius below {radius_limit:g} at a "
        f"period of {1000.0 * rig.period_s:g} ms: choose a longer period"
    )


def pareto_front(candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Return candidates that no other one equals or beats in both errors, by position error."""
    front: list[Candidate] = []
    for item in sorted(candidates, key=lambda c: (c.position_percent, c.force_percent)):
        if not front or item.force_percent < front[-1].force_percent:
            front.append(item)
    return tuple(front)


def _sides(rig: TuningRig) -> Sides:
    """Return plans with errors: stiffness, force and slope too high and too low.

    They are half of the combinations, chosen so that each pair of errors occurs with equal and with
    opposite signs.
    """
    return [
        (
            rig.stiffness_mN_per_um * (1.0 + side * rig.stiffness_error),
            read * rig.force_error_mN,
            1.0 + side * read * rig.slope_error,
        )
        for side, read in product((-1.0, 1.0), repeat=2)
    ]


def _candidate(
    rig: TuningRig, path: TuningPath, settings: LawSettings, errors: Tracked
) -> Candidate:
    position_square = force_square = 0.0
    for x_rms, F_rms in errors:
        position_square += 0.25 * x_rms * x_rms
        force_square += 0.25 * F_rms * F_rms
    force_pp = max(path.force_r_mN[path.settled :]) - min(path.force_r_mN[path.settled :])
    position_pp = force_pp / rig.stiffness_mN_per_um
    return Candidate(
        settings,
        100.0 * sqrt(position_square) / position_pp,
        100.0 * sqrt(force_square) / force_pp,
    )


def track(
    rig: TuningRig,
    path: TuningPath,
    settings: LawSettings,
    planned_mN_per_um: float,
    force_error_mN: float,
    steeper: float = 1.0,
) -> tuple[float, float]:
    """Return r.m.s. errors x - x_r in µm and F - F_r in mN after settling, for x_r = x_e + F_r/K.

    The force passed to the law has an error, and the noise of an estimate from the position.
    """
    samples = len(path.force_r_mN) - path.settled
    if samples < 1 or len(rig.noise_um) < len(path.force_r_mN):
        raise ValueError(
            f"{len(path.force_r_mN)} reference samples and {len(rig.noise_um)} noise "
            f"samples, of which {path.settled} are for settling: too few"
        )
    law = law_on(rig, settings)
    arm = _Arm(rig, steeper)
    x_e_um = arm.x_um
    state = control_law.start(
        law,
        x_um=x_e_um,
        x_r_um=x_e_um,
        force_mN=0.0,
        applied_V=rig.response.voltage_V,
        memory=arm.memory,
    )
    applied_V = rig.response.voltage_V
    position_square = force_square = 0.0
    for index, force_r_mN in enumerate(path.force_r_mN):
        noise_um = rig.noise_um[index]
        x_r_um = x_e_um + force_r_mN / planned_mN_per_um
        state, output = control_law.step(
            law,
            state,
            x_um=arm.x_um + noise_um,
            force_mN=arm.force_mN() + force_error_mN - noise_um * rig.arm.k,
            applied_V=applied_V,
            x_r_um=x_r_um,
            force_r_mN=force_r_mN,
            limited=0,
            memory=arm.memory,
        )
        applied_V = output.voltage_V
        arm.move(applied_V)
        if index >= path.settled:
            off_um, off_mN = arm.x_um - x_r_um, arm.force_mN() - force_r_mN
            position_square += off_um * off_um
            force_square += off_mN * off_mN
    return sqrt(position_square / samples), sqrt(force_square / samples)


def law_on(rig: TuningRig, settings: LawSettings) -> Law:
    """Return the law as it runs on the rig; raises ValueError."""
    response = rig.response
    model = response.model if isinstance(response, IdentifiedResponse) else None
    return control_law.build(settings, rig.arm, rig.period_s, rig.force_filter_s, model)


class _Arm:
    """The pressed arm; the previous voltage acts during the delay, then the new one."""

    def __init__(self, rig: TuningRig, steeper: float) -> None:
        ratio = rig.stiffness_mN_per_um / rig.arm.k
        stiffer = sqrt(1.0 + ratio)
        omega = rig.natural_frequency_rad_per_s * stiffer
        zeta = rig.damping_ratio / stiffer
        period_s = require_positive("period", rig.period_s, "s")
        self._old = sample_mode(omega, zeta, rig.delay_s) if rig.delay_s > 0.0 else None
        self._new = sample_mode(omega, zeta, period_s - rig.delay_s)
        self._rig, self._ratio = rig, ratio
        self._response = rig.response
        self._steeper = steeper
        self._touch_um = self.x_um = rig.response.position_um()
        self._speed_um_per_s = 0.0

    @property
    def memory(self) -> HysteresisState | None:
        """Return the memory of the free response if the law uses it."""
        response = self._response
        return response.memory if isinstance(response, IdentifiedResponse) else None

    def force_mN(self) -> float:
        """Return F = K_e·(x - x_e); the part is not released."""
        return self._rig.stiffness_mN_per_um * (self.x_um - self._touch_um)

    def move(self, voltage_V: float) -> None:
        if self._old is not None:
            self._pass(self._old)
        self._response = self._response.updated(voltage_V, self._rig.period_s)
        self._pass(self._new)

    def _pass(self, mode: Mode) -> None:
        free_um = self._response.position_um()
        if self._steeper != 1.0:
            free_um = self._touch_um + self._steeper * (free_um - self._touch_um)
        rest_um = (free_um + self._ratio * self._touch_um) / (1.0 + self._ratio)
        off_um, v = self.x_um - rest_um, self._speed_um_per_s
        self.x_um = rest_um + mode.xx * off_um + mode.xv * v
        self._speed_um_per_s = mode.vx * off_um + mode.vv * v
