"""Calibrations merged into a rig file: replaceable values, digests, and impossible values."""

from pathlib import Path

import pytest

from pincette.config import Calibration, ConfigError, calibrated, parse_calibration, read_rig

RIG = read_rig(Path("deploy/rigs/demo.toml"))
FOUND = Calibration(
    values={
        "model.compliance_um_per_mN": 0.47,
        "part.stiffness_mN_per_um": 2.05,
        "sensor.noise_um": 0.021,
    },
    sources={"model.compliance_um_per_mN": "20261121-101500-0a1b"},
)


def test_calibrated_values_replace_those_of_the_rig_file() -> None:
    rig = calibrated(RIG, FOUND)
    assert rig.model.compliance_um_per_mN == 0.47
    assert rig.part.stiffness_mN_per_um == 2.05
    assert rig.sensor.noise_um == 0.021
    assert rig.model.free_response == RIG.model.free_response
    assert rig.limits == RIG.limits


def test_an_empty_calibration_leaves_the_rig_file_as_it_is() -> None:
    assert calibrated(RIG, Calibration()) is RIG
    assert Calibration().text() == Calibration().digest == ""
    assert parse_calibration("") == Calibration()


def test_a_free_response_replaces_a_recorded_one() -> None:
    taught = RIG.model.free_response
    assert taught is not None
    values = {"model.free_response": taught.model_dump(mode="json")}
    bare = RIG.model_copy(update={"model": RIG.model.model_copy(update={"free_response": None})})
    assert calibrated(bare, Calibration(values=values)).model.free_response == taught


def test_text_and_digest_depend_on_the_content_only() -> None:
    turned = Calibration(values=dict(reversed(FOUND.values.items())), sources=FOUND.sources)
    assert turned.text() == FOUND.text()
    assert parse_calibration(FOUND.text()) == FOUND
    other = FOUND.model_copy(update={"values": {**FOUND.values, "sensor.noise_um": 0.022}})
    assert len({FOUND.digest, turned.digest, other.digest}) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"values": {"limits.voltage_max_V": 9.0}}', "limits.voltage_max_V: no calibration"),
        ('{"values": []}', "must be an object"),
        ("{", "is not JSON"),
    ],
)
def test_an_invalid_calibration_is_refused(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        parse_calibration(text)


def test_an_impossible_value_is_named() -> None:
    with pytest.raises(ConfigError, match=r"model\.compliance_um_per_mN = -0\.4"):
        calibrated(RIG, Calibration(values={"model.compliance_um_per_mN": -0.4}))
