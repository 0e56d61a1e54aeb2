"""The tables of a second arm: values taken from the first, and refusals."""

import tomllib
from typing import Any

import pytest

from pincette.config import Calibration, ConfigError, RigFile, calibrated, parse_rig, read_rig
from pincette.config.reading import laid_over, parse_rig_json
from tests.support.rigs import DEMO
from tests.support.two_arms import TWO_ARMS

RIG = read_rig(TWO_ARMS)


def tree() -> dict[str, Any]:
    base, own = (tomllib.loads(path.read_text(encoding="utf-8")) for path in (DEMO, TWO_ARMS))
    del own["base"]
    return laid_over(base, own)


def refusal(*changes: dict[str, Any], without: str = "") -> str:
    wanted = tree()
    if without:
        del wanted[without]
    for change in changes:
        wanted = laid_over(wanted, change)
    with pytest.raises(ConfigError) as refused:
        parse_rig(wanted)
    return str(refused.value)


def test_omitted_values_are_those_of_the_first_arm_except_identified_ones() -> None:
    wanted = tree()
    del wanted["second"]["model"]
    del wanted["second"]["contact_um"]
    rig = parse_rig(wanted)
    assert rig.second is not None
    assert rig.second.limits == rig.limits
    assert rig.second.contact_um == rig.part.contact_um
    assert rig.second.model.hysteresis_fraction == rig.model.hysteresis_fraction == 0.06
    assert rig.second.model.free_response is None
    assert rig.model.free_response is not None


def test_each_arm_of_a_rig_of_two_arms_can_be_used_as_a_rig_of_one_arm() -> None:
    first, second = RIG.arms
    assert RIG.second is not None
    assert first.arms == (first,)
    assert (first.model, second.model) == (RIG.model, RIG.second.model)
    assert (first.sensor.url, second.sensor.url) == (RIG.sensor.url, RIG.second.sensor.url)
    assert second.part.contact_um == RIG.second.contact_um
    assert first.simulation is not None
    assert second.simulation is not None
    assert (first.simulation.piezo_um_per_V, second.simulation.piezo_um_per_V) == (24.95, 24.2)
    assert second.simulation.bouc_wen.A_over_d == 0.36
    assert second.simulation.second is None


def test_without_its_own_table_the_second_simulated_arm_equals_the_first() -> None:
    simulation = RIG.simulation
    assert simulation is not None
    one, two = simulation.model_copy(update={"second": None}).arms
    assert one == two
    relays = laid_over(tree(), {"simulation": {"second": {"relays": RELAYS}}})
    del relays["simulation"]["second"]["hysteresis"]
    found = parse_rig(relays).arms[1].simulation
    assert found is not None
    assert found.hysteresis is None
    assert found.relays is not None


RELAYS = {"loop_share": 0.2, "full_drive_V": 1.0}


def test_the_rig_file_is_sent_as_json() -> None:
    assert parse_rig_json(RIG.model_dump_json()) == RIG
    assert parse_rig_json(RIG.model_dump_json()).digest() == RIG.digest()
    assert RIG.serial_numbers == {}


def test_a_calibration_replaces_quantities_of_the_second_arm() -> None:
    found = calibrated(RIG, Calibration(values={"second.model.compliance_um_per_mN": 0.5}))
    assert found.second is not None
    assert found.second.model.compliance_um_per_mN == 0.5
    assert found.model.compliance_um_per_mN == RIG.model.compliance_um_per_mN
    with pytest.raises(ConfigError, match=r"second\.sensor.*missing"):
        calibrated(read_rig(DEMO), Calibration(values={"second.model.damping_ratio": 0.02}))


def test_serial_numbers_of_both_arms_are_reported() -> None:
    numbered = laid_over(tree(), {"second": {"sensor": {"serial_number": "7"}}})
    assert parse_rig(numbered).serial_numbers == {"second.sensor": "7"}


@pytest.mark.parametrize("name", ["sensor", "output"])
def test_both_arms_on_one_channel_are_refused(name: str) -> None:
    same = refusal({"second": {name: {"url": getattr(RIG, name).url}}})
    assert f"second.{name}.url" in same
    assert f"is [{name}] with the same options: give another url, or options" in same


def test_two_outputs_at_the_same_url_need_the_same_line_settings() -> None:
    shared = {"url": RIG.output.url, "options": {"address": 1, "channel": 1}}
    parse_rig(laid_over(tree(), {"second": {"output": shared}}))
    message = refusal({"second": {"output": {**shared, "timeout_s": 0.2}}})
    assert "second.output.timeout_s" in message
    assert "is 0.2 where [output] has 0.1, and both are at 'socket://127.0.0.1:7462'" in message


def test_tables_of_a_missing_second_arm_are_refused() -> None:
    assert "simulation.second" in refusal(without="second")
    assert "this rig has one driven arm; add [second.sensor] and [second.output]" in refusal(
        without="second"
    )
    order = {"at_s": 1.0, "target": "second_output", "what": "off"}
    demo = tomllib.loads(DEMO.read_text(encoding="utf-8"))
    with pytest.raises(ConfigError, match="this rig has one driven arm; name output"):
        parse_rig(laid_over(demo, {"simulation": {"script": [order]}}))
    with pytest.raises(ConfigError, match=r"without \[second\]"):
        parse_rig(laid_over(demo, {"simulation": {"pair": {}}}))


def test_the_second_arm_has_a_single_class_of_hysteresis() -> None:
    both = refusal({"simulation": {"second": {"relays": RELAYS}}})
    assert "both [simulation.second.hysteresis] and [simulation.second.relays]" in both


@pytest.mark.parametrize("odd", [7, [], {"sensor": 3}, {"model": 3, "limits": []}])
def test_an_invalid_table_is_refused(odd: Any) -> None:
    assert "second" in refusal({"second": odd}, without="second")


def test_a_rig_of_one_arm_has_no_second_table() -> None:
    rig: RigFile = read_rig(DEMO)
    assert rig.arms == (rig,)
