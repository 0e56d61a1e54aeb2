"""Figures of docs/explanations/errata.md that no other test has: each law on the exact arm.

Q. Xu, IEEE T-ASE 10(3), 2013; the arm of (54) and (55), T = 20 ms.
"""

import random
from dataclasses import dataclass
from itertools import pairwise
from math import cos, pi, sqrt

import pytest
from msgspec.structs import replace

from pincette.control.arm.mode import sample_mode
from pincette.control.arm.plant import consistent_arm, printed_arm
from pincette.control.force.observers import QuasiStatic, QuasiStaticParameters
from pincette.control.laws.definition import LawSettings
from pincette.control.laws.law import LawState, build, start
from pincette.control.laws.parameters import ParameterSet
from pincette.control.laws.pbsmic import PbsmicState
from pincette.control.laws.sliding import LawOutput
from tests.support.laws import law_settings, step_at

OMEGA_N = sqrt(5.943e6)
ZETA, D_P, S_P, T = 63.4 / OMEGA_N, 19.0, 0.46, 0.02
ARM = consistent_arm(OMEGA_N, ZETA, D_P, S_P)
K_E = 2.15
GAINS = (5.0, 2.0, 1.0, 0.5)


@dataclass
class Bench:
    """The mode, exact from sample to sample, pressed on F = K_e·x, under a law and an observer."""

    settings: LawSettings
    printed_term: bool = False
    sign: float = 1.0
    """−1: F̂ and F_r with the sign of (53) and the plots."""
    noise_um: float = 0.0
    x_um: float = 0.0
    speed: float = 0.0
    voltage_V: float = 0.0

    def __post_init__(self) -> None:
        ratio = K_E * S_P
        self.law = build(self.settings, ARM, T, 0.0)
        self.state = start(self.law, x_um=0.0, x_r_um=0.0, force_mN=0.0, applied_V=0.0)
        self.mode = sample_mode(OMEGA_N * sqrt(1.0 + ratio), ZETA / sqrt(1.0 + ratio), T)
        printed = D_P if self.printed_term else 0.0
        self.observer = QuasiStatic(QuasiStaticParameters(S_P, printed_um_per_V=printed))
        self.chance = random.Random(1)

    def tick(self, x_r_um: float = 0.0, force_r_mN: float = 0.0) -> LawOutput:
        x_um = self.x_um + self.noise_um * self.chance.gauss(0.0, 1.0)
        self.observer, F = self.observer.observe(x_um, D_P * self.voltage_V, self.voltage_V)
        self.state, output = step_at(
            self.law,
            self.state,
            (x_um, self.sign * F, self.voltage_V),
            (x_r_um, self.sign * force_r_mN),
        )
        self.voltage_V, mode = output.voltage_V, self.mode
        rest_um = D_P * self.voltage_V / (1.0 + K_E * S_P)
        off_um, v = self.x_um - rest_um, self.speed
        self.x_um = rest_um + mode.xx * off_um + mode.xv * v
        self.speed = mode.vx * off_um + mode.vv * v
        return output


def as_fed(K_P: float, set_: ParameterSet = "printed", K_f: float = 5000.0) -> LawSettings:
    """PBSMIC with the newest force, as the paper has it."""
    return law_settings("pbsmic", set_, K_P=K_P, K_f=K_f, force_age="newest")


def growth(bench: Bench) -> float:
    """Return the growth factor per tick of a disturbance of 1e-3 µm, with its sign, after 150
    ticks."""
    bench.x_um = 1e-3
    for _ in range(150):
        bench.tick()
    before = bench.voltage_V
    bench.tick()
    return bench.voltage_V / before


def tracking(bench: Bench, x_pp_um: float, force_pp_mN: float) -> tuple[float, float]:
    """Return r.m.s. errors in µm and mN over three cycles of 0.5 Hz, after one."""
    position = force = 0.0
    for tick in range(400):
        share = 0.5 * (1.0 - cos(pi * (tick + 1) * T))
        bench.tick(x_pp_um * share, force_pp_mN * share)
        if tick >= 100:
            position += (bench.x_um - x_pp_um * share) ** 2
            force += (K_E * bench.x_um - force_pp_mN * share) ** 2
    return sqrt(position / 300.0), sqrt(force / 300.0)


def test_the_printed_units_are_off_by_the_stated_factors() -> None:
    printed = printed_arm()
    assert printed.d / ARM.d == pytest.approx(2.73e6, rel=2e-3)
    assert sqrt(printed.k / printed.m) / (2.0 * pi) == pytest.approx(9145.0, abs=1.0)
    assert 0.003 / printed.d == pytest.approx(2.7e-11, rel=0.02)
    assert 1e3 / printed.d * 1e3 * D_P == pytest.approx(0.17, abs=0.005)


@pytest.mark.parametrize(
    ("K_f", "factors"),
    [(5000.0, (-1.25, -1.19, -1.12, -1.04)), (6000.0, (-1.44, -1.37, -1.30, -1.22))],
)
def test_the_printed_set_is_unstable_with_the_printed_term(
    K_f: float, factors: tuple[float, ...]
) -> None:
    found = [growth(Bench(as_fed(K_P, K_f=K_f), printed_term=True)) for K_P in GAINS]
    assert found == pytest.approx(factors, abs=0.01)


def test_the_printed_term_is_tolerated_if_the_gains_are_low() -> None:
    assert -1.0 < growth(Bench(as_fed(0.3), printed_term=True)) < -0.95
    assert growth(Bench(as_fed(0.4), printed_term=True)) < -1.0
    assert -1.0 < growth(Bench(as_fed(2.0, K_f=4000.0), printed_term=True)) < -0.98


def swell(bench: Bench) -> float:
    """Return the mean growth factor per tick of a disturbance that oscillates over more than two
    ticks."""
    bench.x_um, voltages = 1e-3, list[float]()
    for _ in range(200):
        bench.tick()
        voltages.append(abs(bench.voltage_V))
    return (max(voltages[150:]) / max(voltages[50:100])) ** 0.01


def test_the_consistent_set_is_unstable_with_the_printed_term_at_low_gains() -> None:
    found = [swell(Bench(as_fed(K_P, "consistent"), printed_term=True)) for K_P in GAINS]
    assert found == pytest.approx((0.86, 0.98, 1.08, 1.18), abs=0.01)


def test_with_the_force_sign_of_the_plots_the_loop_is_stable_despite_the_printed_term() -> None:
    for K_P in GAINS:
        assert swell(Bench(as_fed(K_P), printed_term=True, sign=-1.0)) < 0.95


def test_without_the_printed_term_the_same_loop_is_stable() -> None:
    found = [growth(Bench(as_fed(K_P))) for K_P in GAINS[:3]]
    assert found == pytest.approx((0.90, 0.78, 0.65), abs=0.01)


def test_the_missing_force_term_increases_the_errors() -> None:
    """A plan that fits: only the law's own lag remains, r.m.s. in µm."""

    def errors(set_: ParameterSet) -> list[float]:
        return [tracking(Bench(as_fed(K_P, set_)), 8.45, K_E * 8.45)[0] for K_P in GAINS]

    assert errors("printed") == pytest.approx((0.61, 0.33, 0.22, 0.16), abs=0.006)
    assert errors("consistent") == pytest.approx((0.04, 0.03, 0.03, 0.02), abs=0.006)


def test_on_a_linear_arm_a_smaller_K_P_lowers_both_errors() -> None:
    """The plan of 8.45 µm and 20 mN; Table I has the force error rise."""
    found = [tracking(Bench(as_fed(K_P)), 8.45, 20.0) for K_P in GAINS]
    for before, after in pairwise(found):
        assert after[0] < before[0]
        assert after[1] < before[1]


def test_the_opposite_sign_of_the_force_increases_the_errors() -> None:
    """The plan of 8.45 µm and 20 mN on a part of 2.15 mN/µm, K_P = 1, the consistent set."""
    settings = as_fed(1.0, "consistent")
    assert tracking(Bench(settings), 8.45, 20.0) == pytest.approx((0.19, 0.71), abs=0.01)
    assert tracking(Bench(settings, sign=-1.0), 8.45, 20.0) == pytest.approx((1.56, 4.16), abs=0.01)


@pytest.mark.parametrize("set_", ["consistent", "printed"])
def test_without_the_switching_term_s_equals_the_change_of_p(set_: ParameterSet) -> None:
    """The p̃_k of (28) add up to p_0 - p_k: s_k = s_0 + (G_a/k̄)(p_k - p_0)."""
    bench = Bench(as_fed(1.0, set_))
    a = 2.0 / bench.law.parameters.plant.k_bar
    for tick in range(200):
        share = 0.5 * (1.0 - cos(pi * (tick + 1) * T))
        output = bench.tick(8.45 * share, 20.0 * share)
        assert output.sliding_um == pytest.approx(a * output.perturbation_mN, abs=1e-9)
        assert abs(output.sliding_um) < 20.0


def test_the_printed_K_S_is_far_below_the_perturbation_error_from_sensor_noise() -> None:
    """For a law with the printed k, 12 nm of noise are a p̃ of 1e5; its K_S is 0.003."""
    bench, square = Bench(as_fed(1.0), noise_um=0.012), 0.0
    for _ in range(1000):
        square += bench.tick().perturbation_error_mN ** 2
    assert sqrt(square / 1000.0) == pytest.approx(1e5, rel=0.1)


@pytest.mark.parametrize(("noise_um", "p_mN"), [(0.012, 0.045), (0.030, 0.112)])
def test_noise_alone_causes_a_perturbation_error(noise_um: float, p_mN: float) -> None:
    bench, square = Bench(as_fed(1.0, "consistent"), noise_um=noise_um), 0.0
    for _ in range(3000):
        square += bench.tick().perturbation_error_mN ** 2
    assert sqrt(square / 3000.0) == pytest.approx(p_mN, rel=0.05)


@pytest.mark.parametrize(("K_P", "share_15"), [(5.0, 1.0 / 6.0), (1.0, 0.5)])
def test_the_first_step_towards_a_distant_reference_depends_on_the_start(
    K_P: float, share_15: float
) -> None:
    """If it starts at the arm's position, nearly the whole distance at once; by (15) the share
    of the gains."""
    law = build(as_fed(K_P, "consistent"), ARM, T, 0.0)
    here = start(law, x_um=0.0, x_r_um=1.0, force_mN=0.0, applied_V=0.0)
    assert isinstance(here.law, PbsmicState)
    by_15 = replace(here, law=replace(here.law, x_d_um=1.0, deviation_1_um=0.0, deviation_2_um=0.0))

    def first(state: LawState) -> LawOutput:
        return step_at(law, state, (0.0, 0.0, 0.0), (1.0, 0.0))[1]

    assert first(here).voltage_V * D_P == pytest.approx(0.98, abs=0.002)
    assert first(here).sliding_um == 0.0
    assert first(by_15).voltage_V * D_P == pytest.approx(share_15, rel=2e-3)
    assert first(by_15).sliding_um == pytest.approx(-(K_P + 1.0))
