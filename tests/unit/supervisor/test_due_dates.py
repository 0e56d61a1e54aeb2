"""Calibrations are due again after a time, and after an instrument was exchanged."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from pincette.config import ConfigError, RigFile, parse_rig
from pincette_supervisor.jobs.bring_up import model_view
from pincette_supervisor.journal.store import Store
from pincette_supervisor.model import Instruments, RigModel, due_at

NOISE, COMPLIANCE = "sensor.noise_um", "model.compliance_um_per_mN"
MEASURED = "2026-03-01T12:00:00.000Z"
DUE = "2026-08-28T12:00:00.000Z"


def kept_up(rig: RigFile, sensor: str = "", output: str = "", days: float | None = None) -> RigFile:
    """Return the rig with serial numbers and a validity period of calibrations."""
    tables = rig.model_dump(exclude_unset=True)
    tables["sensor"]["serial_number"] = sensor
    tables["output"]["serial_number"] = output
    tables["calibration"] = {} if days is None else {"valid_days": days}
    return parse_rig(tables)


def after(days: float) -> datetime:
    return datetime.fromisoformat(MEASURED) + timedelta(days=days)


def test_an_accepted_calibration_states_its_due_date(
    rig_file: RigFile, tmp_path: Path, store: Store
) -> None:
    model = RigModel(kept_up(rig_file, "S1", "O1", 180.0), tmp_path / "models", store)
    begun = datetime.now(UTC)
    model.add({COMPLIANCE: 0.44}, {COMPLIANCE: 0.01}, "a", MEASURED)
    model.add({NOISE: 0.02}, {NOISE: 0.001}, "b")
    by_name = {item.quantity: item for item in model_view(model).quantities}
    compliance, noise = by_name[COMPLIANCE], by_name[NOISE]
    assert compliance.due_at == DUE
    # Measured before the supervisor knew the instruments.
    assert compliance.serial_numbers == {}
    assert noise.serial_numbers == {"sensor": "S1", "output": "O1"}
    assert noise.accepted_at is not None
    assert noise.due_at is not None
    accepted = datetime.fromisoformat(noise.accepted_at)
    assert begun - timedelta(milliseconds=1) <= accepted <= datetime.now(UTC)
    assert datetime.fromisoformat(noise.due_at) - accepted == timedelta(days=180)
    assumed = by_name["part.contact_um"]
    assert (assumed.accepted_at, assumed.due_at, assumed.overdue) == (None, None, False)
    assert assumed.serial_numbers == {}


def test_without_a_configured_validity_no_calibration_is_ever_due(
    rig_file: RigFile, tmp_path: Path, store: Store
) -> None:
    model = RigModel(rig_file, tmp_path / "models", store)
    model.add({NOISE: 0.02}, {}, "a", MEASURED)
    assert model.in_use.acceptances[NOISE].due_at is None
    assert model.warnings(after(1e5)) == []


def test_overdue_calibrations_are_a_warning(
    rig_file: RigFile, tmp_path: Path, store: Store
) -> None:
    model = RigModel(kept_up(rig_file, days=180.0), tmp_path / "models", store)
    model.add({NOISE: 0.02}, {}, "a", MEASURED)
    model.add({COMPLIANCE: 0.44}, {}, "b", "2026-06-01T12:00:00.000Z")
    assert model.warnings(after(180.0)) == []
    assert model.warnings(after(180.1)) == [
        f"{NOISE}: calibration a is overdue since {DUE}; calibrate again"
    ]
    assert len(model.warnings(after(300.0))) == 2
    # Measured again, it is due again from then on.
    model.add({NOISE: 0.03}, {}, "c", "2026-09-01T12:00:00.000Z")
    assert model.warnings(after(190.0)) == []
    # By the wall clock; the year 2000 is in the past.
    model.add({NOISE: 0.04}, {}, "d", "2000-01-01T00:00:00.000Z")
    view = {item.quantity: item.overdue for item in model_view(model).quantities}
    assert view[NOISE] is True


def test_another_instrument_is_a_warning_but_no_refusal(
    rig_file: RigFile, tmp_path: Path, store: Store
) -> None:
    before = RigModel(kept_up(rig_file, "S1", "O1"), tmp_path / "models", store)
    before.add({NOISE: 0.02, COMPLIANCE: 0.44}, {}, "a")
    assert before.warnings(after(0.0)) == []
    again = RigModel(kept_up(rig_file, "S2", "O1"), tmp_path / "models", store)
    assert (again.in_use.version, again.trouble) == (1, "")
    assert again.warnings(after(0.0)) == [
        f"{NOISE}, {COMPLIANCE}: sensor is S2, calibration a was made with S1; calibrate again"
    ]
    unknown = RigModel(kept_up(rig_file), tmp_path / "models", store)
    assert unknown.warnings(after(0.0)) == []


def test_a_calibration_is_stored_with_the_serial_numbers_of_its_instruments(
    rig_file: RigFile, tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = ["2026-02-01T00:00:00.000Z"]
    monkeypatch.setattr("pincette_supervisor.model.utc_now", lambda: now[0])
    RigModel(kept_up(rig_file, "S1"), tmp_path / "models", store)
    RigModel(kept_up(rig_file, "S1"), tmp_path / "models", store)
    now[0] = "2026-04-01T00:00:00.000Z"
    model = RigModel(kept_up(rig_file, "S2"), tmp_path / "models", store)
    model.add({NOISE: 0.02}, {}, "a", MEASURED)
    assert model.in_use.acceptances[NOISE].serial_numbers == {"sensor": "S1"}
    (warning,) = model.warnings(after(0.0))
    assert "sensor is S2, calibration a was made with S1" in warning


def test_changes_of_instruments_are_stored_up_to_a_limit(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pincette_supervisor.model.KEPT_CHANGES", 2)
    for day in (1, 2, 3):
        at = f"2026-03-0{day}T00:00:00.000Z"
        monkeypatch.setattr("pincette_supervisor.model.utc_now", lambda at=at: at)
        known = Instruments(store, "demo", {"sensor": f"S{day}"})
    assert known.at("2026-03-01T12:00:00.000Z") == {}
    assert known.at("2026-03-02T00:00:00.000Z") == {"sensor": "S2"}
    assert known.at("2026-03-09T00:00:00.000Z") == {"sensor": "S3"}


def test_settings_for_maintenance_do_not_change_the_digest_of_the_rig_file(
    rig_file: RigFile,
) -> None:
    assert kept_up(rig_file, "S1", "O1", 180.0).digest() == rig_file.digest()
    part = rig_file.part.model_copy(update={"contact_um": 31.0})
    assert rig_file.model_copy(update={"part": part}).digest() != rig_file.digest()


@pytest.mark.parametrize("days", [0.0, -1.0])
def test_a_time_that_is_invalid_is_refused(rig_file: RigFile, days: float) -> None:
    with pytest.raises(ConfigError, match=r"calibration\.valid_days"):
        kept_up(rig_file, days=days)


def test_a_serial_number_has_a_length(rig_file: RigFile) -> None:
    assert kept_up(rig_file, "S" * 60).serial_numbers == {"sensor": "S" * 60}
    with pytest.raises(ConfigError, match=r"sensor\.serial_number.*60"):
        kept_up(rig_file, "S" * 61)


def test_a_validity_longer_than_the_calendar_has_no_end() -> None:
    assert due_at(MEASURED, 1e9) is None
    assert due_at(MEASURED, None) is None
    assert due_at(MEASURED, 180.0) == DUE
