"""The step detector on the equilibrium of a pressed arm: detections and false alarms."""

from random import Random
from statistics import fmean, pstdev

import pytest

from pincette.control.force.position_steps import (
    AVERAGED,
    REST_MEAN,
    Kappa,
    StepLimits,
    StepWatch,
    mean_step_error_um,
    slip_um,
    unexplained_um,
)
from pincette.control.planning.profiles import quintic

S_P, PLAN_K = 0.46, 2.17
SEED = 46
SOFTEST = Kappa(0.3 * S_P * PLAN_K, known=False)


def limits(noise_um: float, period_s: float = 0.02) -> StepLimits:
    return StepLimits(noise_um, S_P, period_s)


def load(noise_um: float, K_e: float, period_s: float, random: Random) -> list[tuple[float, float]]:
    """Return x and x_1 of a healthy load to 20 mN in 0.45 s, and of a hold of 0.5 s after it."""
    kappa = S_P * K_e
    samples: list[tuple[float, float]] = []
    for tick in range(round(0.95 / period_s)):
        force_mN = 4.0 + 16.0 * quintic(min(1.0, tick * period_s / 0.45))
        x_um = 31.2 + force_mN / K_e
        free_um = x_um + S_P * force_mN
        assert abs(x_um - (free_um + kappa * 31.2) / (1.0 + kappa)) < 1e-9
        samples.append((x_um + random.gauss(0.0, noise_um), free_um))
    return samples


@pytest.mark.parametrize("period_s", [0.02, 0.001])
@pytest.mark.parametrize("noise_um", [0.03, 0.15])
def test_healthy_loads_raise_no_alarm(noise_um: float, period_s: float) -> None:
    random, alarms = Random(SEED), 0
    for _ in range(400 if period_s > 0.01 else 40):
        K_e = PLAN_K * 0.3 * 10.0 ** random.random()
        rule, watch = limits(noise_um, period_s), StepWatch()
        for tick, (x_um, free_um) in enumerate(load(noise_um, K_e, period_s, random)):
            watch = watch.updated(rule, x_um, free_um)
            kappa = Kappa(S_P * K_e * random.uniform(0.9, 1.1))
            if tick * period_s < 0.1:
                kappa = SOFTEST
            alarms += watch.step(rule, kappa) is not None
    print(f"seed {SEED}: {alarms} alarms")
    assert alarms == 0


@pytest.mark.parametrize(
    ("noise_um", "slipped_um"), [(0.03, 1.0), (0.03, 3.0), (0.03, 10.0), (0.15, 10.0)]
)
@pytest.mark.parametrize("known", [True, False])
def test_a_slip_is_found_in_its_first_sample(
    noise_um: float, slipped_um: float, known: bool
) -> None:
    """At the end of a load, where the free arm moves little."""
    random, found = Random(SEED), 0
    kappa, rule = S_P * PLAN_K, limits(noise_um)
    for _ in range(100):
        watch, x_um, free_um = StepWatch(), 0.0, 0.0
        for x_um, free_um in load(noise_um, PLAN_K, 0.02, random)[:22]:
            watch = watch.updated(rule, x_um, free_um)
            assert watch.step(rule, Kappa(kappa) if known else SOFTEST) is None
        step_um = slipped_um * kappa / (1.0 + kappa)
        last_um = x_um + step_um
        watch = watch.updated(rule, last_um, free_um)
        step = watch.step(rule, Kappa(kappa) if known else SOFTEST)
        found += step is not None
        if step is not None and known:
            assert step.forwards
            assert slip_um(step.step_um, kappa) == pytest.approx(slipped_um, abs=10.0 * noise_um)
            again_um = unexplained_um(step, last_um, free_um, Kappa(kappa))
            assert again_um == pytest.approx(step.step_um)
    assert found >= 97


@pytest.mark.parametrize("jump_um", [-0.4, 0.4, -2.0, 2.0])
def test_a_jump_at_rest_is_found_with_its_sign(jump_um: float) -> None:
    random, rule, watch = Random(SEED), limits(0.03), StepWatch()
    for _ in range(50):
        watch = watch.updated(rule, 40.0 + random.gauss(0.0, 0.03), 49.0)
        assert watch.step(rule, Kappa(1.0)) is None
    step = watch.updated(rule, 40.0 + jump_um, 49.0).step(rule, Kappa(1.0))
    assert step is not None
    assert step.forwards == (jump_um > 0.0)
    assert step.step_um == pytest.approx(jump_um, abs=0.1)
    assert step.before_x_um == pytest.approx(40.0, abs=0.1)


@pytest.mark.parametrize("noise_um", [0.03, 0.15])
def test_a_step_at_rest_has_the_stated_standard_error(noise_um: float) -> None:
    random, rule, kappa, errors_um = Random(SEED), limits(noise_um), Kappa(1.0), list[float]()
    for _ in range(400):
        watch = StepWatch()
        for _tick in range(2 * REST_MEAN):
            watch = watch.updated(rule, 40.0 + random.gauss(0.0, noise_um), 49.0)
        after_um = [38.0 + random.gauss(0.0, noise_um) for _ in range(AVERAGED)]
        step = watch.updated(rule, after_um[0], 49.0).step(rule, kappa)
        assert step is not None
        shown_um = [unexplained_um(step, x_um, 49.0, kappa) for x_um in after_um]
        errors_um.append(fmean(shown_um) + 2.0)
    assert pstdev(errors_um, 0.0) == pytest.approx(mean_step_error_um(noise_um), rel=0.1)


@pytest.mark.parametrize("noise_um", [0.03, 0.15])
@pytest.mark.parametrize("wrong", [0.6, 1.5])
def test_a_press_with_an_uncertain_stiffness_raises_no_alarm(noise_um: float, wrong: float) -> None:
    """A line fitted to a small load of an arm with unknown history was wrong by 40 %."""
    random, rule, kappa, alarms = Random(SEED), limits(noise_um), S_P * PLAN_K, 0
    for _ in range(100):
        watch, free_um = StepWatch(), 30.0
        for _tick in range(50):
            free_um += 0.8
            x_um = (free_um + kappa * 31.2) / (1.0 + kappa) + random.gauss(0.0, noise_um)
            watch = watch.updated(rule, x_um, free_um)
            alarms += watch.step(rule, Kappa(wrong * kappa)) is not None
    assert alarms == 0


def test_a_backward_step_is_not_reported_before_the_contact_line_is_known() -> None:
    rule, watch = limits(0.03), StepWatch()
    for x_um in (30.0, 30.1, 30.2):
        watch = watch.updated(rule, x_um, x_um)
    assert watch.updated(rule, 29.0, 30.3).step(rule, SOFTEST) is None
    assert watch.updated(rule, 31.0, 30.3).step(rule, SOFTEST) is not None


@pytest.mark.parametrize("period_s", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("slipped_um", [1.0, 3.0, 10.0])
def test_at_short_periods_a_slip_is_detected_within_3_ms(
    period_s: float, slipped_um: float
) -> None:
    """With the ring of the pressed mode, which decays by 63 1/s."""
    from math import cos, exp, pi

    random, rule, watch, kappa = Random(SEED), limits(0.03, period_s), StepWatch(), S_P * PLAN_K
    for _ in range(40):
        watch = watch.updated(rule, 40.0 + random.gauss(0.0, 0.03), 49.0)
        assert watch.step(rule, Kappa(kappa)) is None
    for tick in range(1, 40):
        t_s = tick * period_s - 0.5 * period_s
        ring = 1.0 - exp(-63.0 * t_s) * cos(2.0 * pi * 548.0 * t_s)
        x_um = 40.0 + ring * slipped_um * kappa / (1.0 + kappa) + random.gauss(0.0, 0.03)
        watch = watch.updated(rule, x_um, 49.0)
        if watch.step(rule, Kappa(kappa)) is not None:
            assert t_s < 0.004
            return
    pytest.fail("the slip was not found")


@pytest.mark.parametrize(
    "wrong", [{"noise_um": -0.1}, {"compliance_um_per_mN": 0.0}, {"period_s": 0.0}]
)
def test_impossible_numbers_are_refused(wrong: dict[str, float]) -> None:
    values = {"noise_um": 0.03, "compliance_um_per_mN": S_P, "period_s": 0.02} | wrong
    with pytest.raises(ValueError, match="must"):
        StepLimits(**values)


def test_the_slip_of_a_part_without_stiffness_is_refused() -> None:
    with pytest.raises(ValueError, match="s_p·K_e"):
        slip_um(1.0, 0.0)
