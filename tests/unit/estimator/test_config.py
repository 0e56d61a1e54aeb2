"""The force observer that a rig file gets, and those that are refused for it."""

import pytest

from pincette.config import ConfigError, parse_rig
from pincette.control.force.inverse_dynamics import InverseDynamics
from pincette.control.force.kalman import AugmentedKalman
from pincette.control.force.observers import QuasiStatic
from pincette_estimator.config import configure
from tests.unit.estimator.bench import DEMO, a_rig

OBSERVERS = {
    "quasi_static": QuasiStatic,
    "inverse_dynamics": InverseDynamics,
    "kalman": AugmentedKalman,
}


@pytest.mark.parametrize("name", OBSERVERS)
def test_the_rig_file_names_the_observer(name: str) -> None:
    config = configure(a_rig(None, force_observer=name))
    assert isinstance(config.arms[0].observer, OBSERVERS[name])
    assert config.arms[0].noise_um == pytest.approx(
        DEMO.sensor.noise_um * config.arms[0].observer.noise_gain
    )


def test_a_short_period_does_not_affect_the_quasi_static_observer() -> None:
    configure(a_rig(None, period_s=0.0052))
    with pytest.raises(ConfigError) as refused:
        configure(a_rig(None, period_s=0.005))
    for part in (
        'model.force_observer = "quasi_static"',
        "period_s = 0.005 s is below 0.00515 s",
        'choose "smooth", "inverse_dynamics" or "kalman"',
    ):
        assert part in str(refused.value)
    for name in ("inverse_dynamics", "kalman"):
        configure(a_rig(None, period_s=0.001, force_observer=name))


def test_an_inverse_that_only_amplifies_noise_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"inverse_dynamics.*amplify noise"):
        configure(a_rig(None, period_s=0.0026, force_observer="inverse_dynamics"))


def test_printed_ages_belong_to_the_quasi_static_observer() -> None:
    tree = DEMO.model_dump(exclude_none=True)
    tree["model"] |= {"force_ages": "printed", "force_observer": "kalman"}
    with pytest.raises(ConfigError, match='force_ages = "printed" with force_observer = "kalman"'):
        parse_rig(tree)


def test_the_number_of_samples_of_a_rest_follows_the_period_within_bounds() -> None:
    for period_s, count in ((0.05, 10), (0.02, 10), (0.01, 20), (0.001, 64)):
        rig = a_rig(None, period_s=period_s, force_observer="kalman")
        assert configure(rig).arms[0].zero_limits.rest_samples == count


def test_the_limits_of_a_zero_are_computed_from_the_part() -> None:
    limits = configure(a_rig(None)).arms[0].zero_limits
    assert limits.first_touch_um == pytest.approx(27.0)
    assert limits.touch_um == pytest.approx(0.46 * 2.0)
