"""Check that instruments fit the control period: sum, terms, and refusal to arm."""

from pathlib import Path

import pytest

from pincette.config import RigFile, parse_rig, read_rig
from pincette.config.reading import laid_over
from pincette.core.messages import Ack, Arm, Reset
from pincette.core.messages.requests import ExchangeTimes
from pincette.engine.runner import Runner
from pincette.engine.timing_budget import budget
from pincette_actuator import SERVICE as ACTUATOR
from tests.support.rigs import Tree

DEMO = read_rig(Path("deploy/rigs/demo.toml"))
DC205: Tree = {"driver": "srs_dc205", "options": {"range_V": 10}}


def rig(sensor_baud: int, output: Tree) -> RigFile:
    """Return the demo rig with these lines."""
    tree = DEMO.model_dump(mode="json", exclude_unset=True)
    tree["output"] = {"driver": "icpdas_i7024", "url": tree["output"]["url"], **output}
    return parse_rig(laid_over(tree, {"sensor": {"options": {"baud": sensor_baud}}}))


def i7024(baud: int) -> Tree:
    return {"options": {"baud": baud, "watchdog_s": 0.0}}


@pytest.mark.parametrize(
    ("sensor_baud", "output", "parts_ms"),
    [
        (115200, i7024(115200), (1.8, 1.2, 10.0)),
        (38400, DC205, (5.5, 3.6, 0.0)),
        (38400, i7024(38400), (5.5, 3.6, 10.0)),
        (9600, i7024(9600), (21.9, 14.6, 10.0)),
    ],
)
def test_the_timing_budget_is_the_sum_of_transmissions_and_response(
    sensor_baud: int, output: Tree, parts_ms: tuple[float, float, float]
) -> None:
    found = budget(rig(sensor_baud, output))
    (laser,), (device,) = found.sensors, found.outputs
    parts = (laser.exchange_s, device.exchange_s, device.response_s)
    assert [1e3 * part for part in parts] == pytest.approx(parts_ms, abs=0.06)
    assert found.total_s == pytest.approx(sum(parts) + found.computing_s)
    assert found.fits == (sum(parts_ms) + 1e3 * found.computing_s <= 20.0)


def test_a_rig_is_armed_only_if_its_instruments_fit_into_the_period() -> None:
    for baud, refused in ((115200, False), (38400, True), (9600, True)):
        slow = rig(baud, i7024(baud))
        runner = Runner(ACTUATOR, slow, Still())
        runner.call(Reset(acknowledge=True), 0.0)
        reply, _ = runner.call(Arm(1, 1, slow.digest()), 0.0)
        if not refused:
            assert reply == Ack(-1)
            continue
        assert isinstance(reply, str)
        assert reply.startswith("the instruments are too slow: sensor exchange ")
        assert "above the control period of 20 ms" in reply


@pytest.mark.parametrize(
    ("sensor_s", "output_s", "fits"),
    [(0.0025, 0.0023, True), (0.009, 0.005, True), (0.027, 0.024, False), (0.012, 0.008, False)],
)
def test_measured_exchanges_must_leave_time_for_the_loop(
    sensor_s: float, output_s: float, *, fits: bool
) -> None:
    stated = budget(rig(115200, i7024(115200)))
    found = stated.measured(
        [ExchangeTimes(40, sensor_s, sensor_s, sensor_s)],
        [ExchangeTimes(40, output_s, output_s, output_s)],
    )
    assert found.loop_s == pytest.approx(sensor_s + output_s + found.computing_s)
    assert found.fits == fits


def test_the_timing_budget_lists_every_contribution() -> None:
    words = budget(rig(38400, i7024(38400))).words()
    assert words == (
        "sensor exchange 5.5 + command exchange 3.6 + output response 10.0 + computing 2.0 = "
        "21.1 ms, above the control period of 20 ms"
    )


def test_the_bandwidth_is_that_of_the_slower_instrument() -> None:
    slow = budget(rig(115200, i7024(115200)))
    assert slow.bandwidth_hz == pytest.approx(3.0 / (2.0 * 3.14159265 * 0.010), rel=1e-6)
    assert slow.bandwidth_hz < 388.0
    fast = budget(read_rig(Path("deploy/rigs/fast.toml")))
    assert fast.bandwidth_hz > 4.0 * 388.0


class Still:
    """An output at a constant 0 V."""

    def write_V(self, voltage_V: float) -> None:
        assert voltage_V == 0.0

    def read_V(self) -> float:
        return 0.0

    def close(self) -> None:
        """Do nothing: there is no port to close."""
