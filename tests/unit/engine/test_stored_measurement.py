"""The measurement of a machine is stored, found only on that machine, and reported."""

import json
import platform
from pathlib import Path

import pytest

from pincette.cli.up import machine_words
from pincette.config import read_rig
from pincette.diagnostics.machine import measured
from pincette.engine.measuring.kept import FILE, changes_of, how, keep, kept
from pincette.engine.measuring.machine import Findings
from pincette.latency.rule import Measured
from tests.support.histograms import counted

RIG = read_rig(Path("deploy/rigs/demo.toml"))
AT = "2026-03-01T12:00:00+00:00"
HOP = counted([0.0002] * 1000)


def findings(late_s: float, refused: str = "") -> Findings:
    wake_ups = (
        Measured(0.02, counted([1e-4] * 999 + [late_s]), 1),
        Measured(0.001, counted([1e-4] * 1000), 0),
    )
    return Findings(wake_ups, HOP, refused, "", 2, None, False)


def test_a_measurement_is_found_as_stored(tmp_path: Path) -> None:
    data, found = tmp_path / "data", findings(0.031, "fixed priority 10")
    keep(data, found, AT)
    known = kept(data)
    assert known is not None
    assert (known.wake_ups, known.hop, known.refused) == (found.wake_ups, HOP, found.refused)
    assert changes_of(RIG, known) == changes_of(RIG, found)


def test_another_machine_or_a_damaged_file_gives_no_measurement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert kept(tmp_path) is None
    keep(tmp_path, findings(0.031), AT)
    text = (tmp_path / FILE).read_text(encoding="utf-8")
    damaged = ("", "[]", "{}", text[:-20], json.dumps({**json.loads(text), "hop": {"counts": [1]}}))
    for one in damaged:
        (tmp_path / FILE).write_text(one, encoding="utf-8")
        assert kept(tmp_path) is None
    (tmp_path / FILE).write_text(text, encoding="utf-8")
    monkeypatch.setattr(platform, "node", lambda: "another")
    assert kept(tmp_path) is None


def test_up_and_doctor_report_the_measurement_with_suitable_settings(tmp_path: Path) -> None:
    assert machine_words(RIG, tmp_path) == [
        "the timing of this machine is not known:",
        f"  {how(RIG)}",
    ]
    (finding,) = measured(RIG, tmp_path)
    assert (finding.mark, finding.remedy) == ("note", how(RIG))
    keep(tmp_path, findings(1e-4), AT)
    assert len(machine_words(RIG, tmp_path)) == 1
    assert [one.mark for one in measured(RIG, tmp_path)] == ["ok"]
    keep(tmp_path, findings(0.031), AT)
    reported, change = machine_words(RIG, tmp_path)
    assert reported.startswith(
        "this machine wakes up late by 31.0 ms at most, p99.9 0.1 ms, at 20 ms"
    )
    assert change.startswith("suits it: [safety] command_age_periods = 4.5 (")
    assert [one.mark for one in measured(RIG, tmp_path)] == ["ok", "note"]
