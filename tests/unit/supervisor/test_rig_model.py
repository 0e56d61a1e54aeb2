"""Versions of a model as files, and which of them is in use."""

import json
from pathlib import Path

import pytest

from pincette.config import ConfigError, RigFile
from pincette_supervisor.journal.store import Store
from pincette_supervisor.model import RigModel
from pincette_supervisor.plugin.model_in_use import assumed_for_force

NOISE, COMPLIANCE = "sensor.noise_um", "model.compliance_um_per_mN"


@pytest.fixture
def model(rig_file: RigFile, tmp_path: Path, store: Store) -> RigModel:
    return RigModel(rig_file, tmp_path / "models", store)


def test_new_values_override_earlier_ones(model: RigModel) -> None:
    first = model.add({NOISE: 0.02}, {NOISE: 0.001}, "a")
    second = model.add({COMPLIANCE: 0.44}, {COMPLIANCE: None}, "b")
    assert (first.version, second.version) == (1, 2)
    assert model.rig.sensor.noise_um == 0.02
    assert model.rig.model.compliance_um_per_mN == 0.44
    assert second.calibration.sources == {NOISE: "a", COMPLIANCE: "b"}
    assert second.uncertainties == {NOISE: 0.001, COMPLIANCE: None}
    assert model.files.read(2).previous == first.digest
    assert model.digest == model.file.digest() != model.rig.digest()


def test_a_version_is_complete_and_named_by_its_digest(model: RigModel, tmp_path: Path) -> None:
    added = model.add({NOISE: 0.02}, {NOISE: 0.001}, "a")
    (path,) = (tmp_path / "models" / "demo").iterdir()
    assert path.name == f"0001-{added.digest}.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    assert (content["rig"], content["rig_file_digest"]) == ("demo", model.digest)
    assert content["values"] == {NOISE: 0.02}
    assert content["previous"] == ""


def test_an_impossible_value_changes_nothing(model: RigModel, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"model\.compliance_um_per_mN = -0\.4"):
        model.add({COMPLIANCE: -0.4}, {}, "a")
    assert model.in_use.version == 0
    assert not (tmp_path / "models").exists()


def test_a_version_that_cannot_be_written_changes_nothing(model: RigModel, tmp_path: Path) -> None:
    (tmp_path / "models").write_text("a file where the folder should be")
    with pytest.raises(OSError, match="models"):
        model.add({NOISE: 0.02}, {}, "a")
    assert model.in_use.version == 0


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("0.02", "0.025", "was changed"),
        ('"previous": ""', '"previous": ', "cannot be used"),
        ('"version": 1', '"version": 2', "names version 2"),
        (NOISE, "limits.force_max_mN", "no calibration replaces that"),
    ],
    ids=["value", "cut", "version", "quantity"],
)
def test_a_file_that_was_changed_is_not_used(
    model: RigModel,
    rig_file: RigFile,
    tmp_path: Path,
    store: Store,
    before: str,
    after: str,
    words: str,
) -> None:
    model.add({NOISE: 0.02}, {}, "a")
    (path,) = (tmp_path / "models" / "demo").iterdir()
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        model.files.read(1)
    again = RigModel(rig_file, tmp_path / "models", store)
    assert again.in_use.version == 0
    assert again.rig == rig_file
    assert words in again.trouble


def test_version_numbers_of_the_model_continue_after_a_return_to_an_earlier_version(
    model: RigModel,
) -> None:
    model.add({NOISE: 0.02}, {}, "a")
    model.use(0)
    assert model.rig == model.file
    added = model.add({NOISE: 0.04}, {}, "b")
    assert added.version == 2
    assert model.files.read(2).previous == ""


def test_values_that_the_force_assumes_are_listed_until_they_are_calibrated(
    model: RigModel,
) -> None:
    drifts = {f"model.{name}" for name in ("creep_mN_per_decade", "forgotten_mN")}
    alone = model.in_use
    assert {NOISE, COMPLIANCE, "model.forgotten_scale_V", *drifts} < set(
        assumed_for_force(alone.rig, alone.calibration)
    )
    found = model.add({NOISE: 0.02, COMPLIANCE: 0.44}, {NOISE: None, COMPLIANCE: None}, "a")
    assumed = assumed_for_force(found.rig, found.calibration)
    assert {NOISE, COMPLIANCE}.isdisjoint(assumed)
    assert drifts < set(assumed)
