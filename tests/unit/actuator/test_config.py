"""Each limit of the actuator is taken from its own section of the rig file."""

from math import pi

import pytest

from pincette.config import ConfigError
from pincette.control.safety.arm import ArmLimits
from pincette.control.safety.freshness import AgeLimits
from pincette.control.safety.monitors import MonitorLimits
from pincette.control.safety.state import SafetyLimits
from pincette.control.safety.voltage import VoltageLimits
from pincette_actuator.config import configure, wake_s
from pincette_actuator.step import SERVICE
from tests.support.rigs import demo_rig

CHANGES = {
    "rig": {"period_s": 0.01},
    "limits": {
        "voltage_min_V": -2.0,
        "voltage_max_V": 5.0,
        "slew_V_per_s": 8.0,
        "sweep_V": 0.05,
        "position_min_um": -10.0,
        "position_max_um": 90.0,
        "force_max_mN": 30.0,
    },
    "safety": {
        "command_age_periods": 3.5,
        "ramp_s": 0.03,
        "safe_V": 0.5,
        "freeze_s": 7.0,
        "force_factor": 1.5,
        "force_samples": 4,
        "following_um": 2.0,
        "following_s": 0.02,
        "following_for_s": 0.08,
        "position_margin": 0.2,
        "position_samples": 2,
    },
}


@pytest.mark.parametrize("time", ["real", "lockstep"])
def test_every_limit_is_taken_from_its_section(time: str) -> None:
    assert configure(demo_rig(CHANGES, time=time)) == SafetyLimits(
        period_s=0.01,
        lockstep=time == "lockstep",
        age=AgeLimits(
            limit_s=3.5 * 0.01,
            limit_ticks=3,
            grace_s=50.0 * 0.01,
            wake_s=pi / 2437.8,
            excused_s=10.0 * 0.01,
        ),
        arms=(
            ArmLimits(
                VoltageLimits(-2.0, 5.0, 8.0 * 0.01, 0.05, 20.0 / 2**14),
                MonitorLimits(
                    period_s=0.01,
                    force_mN=1.5 * 30.0,
                    force_samples=4,
                    following_um=2.0,
                    following_s=0.02,
                    following_samples=8,
                    position_min_um=-10.0 - 0.2 * 100.0,
                    position_max_um=90.0 + 0.2 * 100.0,
                    position_samples=2,
                    fastest_um_per_s=8.0 * demo_rig().model.piezo_um_per_V,
                ),
            ),
        ),
        ramp_s=0.03,
        freeze_s=7.0,
        safe_V=0.5,
    )


@pytest.mark.parametrize("safe_V", [-1.0, 4.0])
def test_a_safe_voltage_may_be_at_the_end_of_the_range(safe_V: float) -> None:
    assert configure(demo_rig({"safety": {"safe_V": safe_V}})).safe_V == safe_V


@pytest.mark.parametrize("safe_V", [-1.1, 4.1])
def test_an_impossible_safe_voltage_is_refused(safe_V: float) -> None:
    with pytest.raises(ConfigError) as caught:
        configure(demo_rig({"safety": {"safe_V": safe_V}}))
    assert str(caught.value) == f"[safety] safe_V = {safe_V} V is outside -1.0..4.0 V"


@pytest.mark.parametrize(
    ("period_s", "frequency_hz", "half_swings"),
    [
        (0.02, 388.0, 3),
        (0.02, 350.0, 3),
        (0.02, 600.0, 5),
        (0.02, 263.0, 1),
        (0.01, 388.0, 1),
        (0.1, 388.0, 15),
    ],
)
def test_ramp_steps_are_an_odd_number_of_half_oscillation_periods_apart(
    period_s: float, frequency_hz: float, half_swings: int
) -> None:
    taken_s = wake_s(period_s, 2.0 * pi * frequency_hz)
    assert taken_s == pytest.approx(half_swings / (2.0 * frequency_hz), rel=1e-12)
    assert taken_s <= 0.25 * period_s


def test_the_service_wakes_as_often_as_its_age_limits_require() -> None:
    assert SERVICE.wake_s is not None
    assert SERVICE.wake_s(configure(demo_rig())) == pytest.approx(3.0 * pi / 2437.8, rel=1e-12)


@pytest.mark.parametrize("period_s", [0.001, 0.005])
def test_a_sampling_period_shorter_than_half_an_oscillation_is_divided(period_s: float) -> None:
    assert wake_s(period_s, 2437.8) == pytest.approx(0.2 * period_s, rel=1e-12)


def test_a_single_ramp_step_may_cover_the_whole_range() -> None:
    assert wake_s(1.0, 4.0 * pi) == 0.25
