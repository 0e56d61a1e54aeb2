"""Confirmations that doctor requires of a person; each finding is printed once."""

from io import StringIO
from pathlib import Path

import pytest

from pincette.cli.doctor import consent, moved
from pincette.cli.main import main
from pincette.config import read_rig
from tests.support.rigs import DEMO

RIG = read_rig(DEMO)


@pytest.mark.parametrize(
    ("typed", "agreed"), [("y", True), ("Yes", True), ("", False), ("no", False)]
)
def test_a_motion_needs_the_consent_of_a_person(
    monkeypatch: pytest.MonkeyPatch, typed: str, agreed: bool
) -> None:
    monkeypatch.setattr("sys.stdin", StringIO(f"{typed}\n"))
    assert consent("?") is agreed


def test_a_direction_check_without_confirmation_is_missing() -> None:
    finding = moved(RIG, lambda _question: False)
    assert finding.mark == "missing"
    assert "not confirmed" in finding.what


def test_warnings_of_a_driver_are_not_repeated_with_the_findings(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "bench.toml"
    assert main(["init", str(path), "--yes", "--sensor-url", "socket://127.0.0.1:9"]) == 0
    capsys.readouterr()
    assert main(["doctor", "--rig", str(path), "--data", str(tmp_path)]) == 1
    output = capsys.readouterr()
    assert (output.out + output.err).count(
        "keyence_lkg has not been tested with its instrument"
    ) == 1
