"""Properties of all force observers, and the quasi-static one with every age of its inputs."""

from itertools import pairwise
from math import pi, sin, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pincette.control.force.estimation import force, smoothing
from pincette.control.force.inverse_dynamics import inverse_dynamics
from pincette.control.force.kalman import augmented_kalman
from pincette.control.force.observers import (
    ForceObserver,
    QuasiStatic,
    QuasiStaticParameters,
    held_age,
    least_period_s,
    state_of,
    with_state,
)
from tests.unit.control.force.exact_arm import OMEGA_N, S_P, ZETA

D_P, PERIOD_S = 19.0, 0.02
OBSERVERS: dict[str, ForceObserver] = {
    "matched": QuasiStatic(QuasiStaticParameters(S_P)),
    "printed": QuasiStatic(QuasiStaticParameters(S_P, 0.4, True, D_P)),
    "smooth": QuasiStatic(QuasiStaticParameters(S_P, older=0.15)),
    "inverse": inverse_dynamics(OMEGA_N, ZETA, S_P, period_s=0.001, filter_s=0.0005),
    "kalman": augmented_kalman(OMEGA_N, ZETA, S_P, period_s=0.001, noise_um=0.03),
}
ALL = pytest.mark.parametrize("name", OBSERVERS)
Numbers = tuple[float, ...]


def mapped(observer: ForceObserver, state: Numbers, inputs: Numbers) -> list[float]:
    """Return the state and reading that follow from a state and (x, x_1, u)."""
    after, force_mN = with_state(observer, state).observe(*inputs)
    return [*state_of(after), force_mN]


@ALL
@given(data=st.data())
def test_an_observer_is_linear_in_inputs_and_state(name: str, data: st.DataObject) -> None:
    observer = OBSERVERS[name]
    count = len(state_of(observer))
    number = st.floats(-10.0, 10.0)

    def draw(length: int) -> Numbers:
        return tuple(data.draw(st.lists(number, min_size=length, max_size=length)))

    one, other = (draw(count), draw(3)), (draw(count), draw(3))
    a, b = draw(2)

    def mixed(first: Numbers, second: Numbers) -> Numbers:
        return tuple(a * p + b * q for p, q in zip(first, second, strict=True))

    both = mapped(observer, mixed(one[0], other[0]), mixed(one[1], other[1]))
    wanted = [
        a * p + b * q for p, q in zip(mapped(observer, *one), mapped(observer, *other), strict=True)
    ]
    # The speed of the mode reaches 1e5 µm/s.
    assert both == pytest.approx(wanted, rel=1e-9, abs=1e-6)


@ALL
def test_after_a_restart_a_resting_arm_reads_its_force_at_once(name: str) -> None:
    observer = OBSERVERS[name].restart(25.4, 30.0, 1.5)
    for _ in range(5):
        observer, force_mN = observer.observe(25.4, 30.0, 1.5)
        assert force_mN == pytest.approx(10.0, rel=1e-9)


@ALL
def test_a_restored_state_equals_the_saved_one(name: str) -> None:
    observer, _ = OBSERVERS[name].restart(1.0, 5.0, 0.3).observe(1.1, 5.2, 0.4)
    fresh = OBSERVERS[name]
    assert with_state(fresh, state_of(observer)) == observer
    with pytest.raises(ValueError, match="argument 2"):
        with_state(fresh, (*state_of(observer), 0.0))


def rms_of_free_arm(*, newest_voltage: bool, printed_term: bool) -> float:
    """Return the r.m.s. force estimated on a free linear arm, x_k = d_p·u_{k-1}, at 2 V peak to
    peak, 0.5 Hz."""
    parameters = QuasiStaticParameters(
        S_P,
        newest_voltage=newest_voltage,
        printed_um_per_V=D_P if printed_term else 0.0,
    )
    observer, squares = QuasiStatic(parameters), 0.0
    for tick in range(-5, 100):
        u_1 = sin(2.0 * pi * 0.5 * tick * PERIOD_S)
        observer, reading_mN = observer.observe(D_P * u_1, D_P * u_1, u_1)
        squares += reading_mN * reading_mN if tick >= 0 else 0.0
    return sqrt(squares / 100)


def test_position_and_voltage_of_the_same_age_give_no_force_on_a_free_arm() -> None:
    assert rms_of_free_arm(newest_voltage=False, printed_term=False) == 0.0


def test_different_ages_or_the_printed_term_turn_motion_into_an_apparent_force() -> None:
    assert rms_of_free_arm(newest_voltage=True, printed_term=False) == pytest.approx(1.83, abs=0.01)
    assert rms_of_free_arm(newest_voltage=False, printed_term=True) == pytest.approx(1.83, abs=0.01)
    assert rms_of_free_arm(newest_voltage=True, printed_term=True) == pytest.approx(3.67, abs=0.01)


def test_the_printed_term_is_right_if_x_1_is_a_sample_older_than_x() -> None:
    observer = QuasiStatic(QuasiStaticParameters(S_P, printed_um_per_V=D_P))
    voltages = [sin(0.3 * tick) for tick in range(20)]
    observer = observer.restart(0.0, 0.0, 0.0)
    for before, voltage_V in pairwise(voltages):
        observer, reading_mN = observer.observe(D_P * voltage_V, D_P * before, voltage_V)
        assert reading_mN == pytest.approx(0.0, abs=1e-12)


def test_the_low_pass_filter_has_the_configured_smoothing_factor() -> None:
    share = smoothing(PERIOD_S, 0.03)
    observer = QuasiStatic(QuasiStaticParameters(S_P, share)).restart(0.0, 0.0, 0.0)
    wanted_mN = 0.0
    for x_um in (-1.0, -2.0, -0.5):
        observer, force_mN = observer.observe(x_um, 0.0, 0.0)
        wanted_mN += share * (force(x_um, 0.0, S_P) - wanted_mN)
        assert force_mN == pytest.approx(wanted_mN)
    assert observer.noise_gain == pytest.approx(sqrt(share / (2.0 - share)))


def test_the_quasi_static_observer_needs_at_least_two_periods_of_the_mode() -> None:
    assert least_period_s(OMEGA_N) == pytest.approx(2.0 / 388.0, rel=1e-4)


def test_impossible_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match=r"compliance = 0.0 µm/mN"):
        QuasiStaticParameters(0.0)
    with pytest.raises(ValueError, match=r"piezoelectric constant = -1.0 µm/V"):
        QuasiStaticParameters(S_P, printed_um_per_V=-1.0)
    for share in (0.0, 1.1):
        with pytest.raises(ValueError, match=f"share of the low-pass = {share}"):
            QuasiStaticParameters(S_P, share)


def test_the_estimate_uses_the_voltages_that_act_on_x_despite_the_output_delay() -> None:
    """A free arm that follows the mean of its steps has an estimated force of 0, however late
    they come."""
    assert [held_age(delay) for delay in (0.0, 0.5, 0.65, 1.0, 3.0)] == pytest.approx(
        [0.0, 0.0, 0.15, 0.5, 1.0]
    )
    for delay in (0.65, 1.0):
        observer = QuasiStatic(QuasiStaticParameters(S_P, older=held_age(delay)))
        observer = observer.restart(0.0, 0.0, 0.0)
        for tick in range(1, 20):
            free_um = 0.3 * tick
            mean_um = 0.3 * (tick + 0.5 - delay)
            observer, F_mN = observer.observe(mean_um, free_um, 0.0)
            if tick > 1:
                assert F_mN == pytest.approx(0.0, abs=1e-12)


def test_an_impossible_age_of_x_1_is_refused() -> None:
    with pytest.raises(ValueError, match="share of the x_1 before"):
        QuasiStaticParameters(S_P, older=1.1)
