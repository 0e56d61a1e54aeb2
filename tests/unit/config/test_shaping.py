"""Steps of the voltage in parts, as a rig file requests them."""

import pytest

from pincette.config import ConfigError, RigFile, read_rig
from pincette.config.reading import laid_over
from pincette.engine.timing_budget import budget
from tests.support.rigs import DEMO, Tree, at_own_ports

FAST = DEMO.with_name("fast.toml")
SHAPED: Tree = {"output": {"shaping": True}, "model": {"output_delay_s": 0.002}}


def fast(changes: Tree) -> RigFile:
    return at_own_ports(read_rig(FAST), changes)


def test_shaping_is_off_by_default() -> None:
    rig = fast({})
    assert rig.shaping_s is None
    assert rig.output_timing == rig.model.output(rig.rig.period_s)


def test_the_interval_follows_the_calibrated_mode() -> None:
    rig = fast(SHAPED)
    assert rig.shaping_s == pytest.approx(0.00107, rel=0.01)
    slower = rig.model.model_copy(update={"natural_frequency_rad_per_s": 2000.0})
    found_s = rig.model_copy(update={"model": slower}).shaping_s
    assert rig.shaping_s is not None
    assert found_s == pytest.approx(rig.shaping_s * 2437.8 / 2000.0)


def test_a_configured_shaping_interval_is_used() -> None:
    rig = fast(laid_over(SHAPED, {"output": {"shaping_interval_s": 0.0012}}))
    assert rig.shaping_s == 0.0012
    assert rig.output_timing.delay_s == pytest.approx(0.0032)


def test_shaped_steps_are_part_of_the_timing_budget() -> None:
    parts_s = budget(fast(SHAPED)).total_s - budget(fast({})).total_s
    # Two intervals, and two more calls to the device.
    assert parts_s == pytest.approx(2.0 * 0.00107 + 2.0 * 0.001, rel=0.01)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"output": {"shaping": False, "shaping_interval_s": 0.001}}, "shaping_interval_s"),
        ({"model": {"force_observer": "kalman"}}, "kalman"),
        ({"rig": {"period_s": 0.004}}, "period of 4 ms"),
        ({"output": {"shaping_interval_s": 0.01}}, "period of 20 ms"),
    ],
)
def test_impossible_shaping_is_refused(changes: Tree, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        fast(laid_over(SHAPED, changes))
