"""The command that repeats the paper: its refusals and its output."""

from pathlib import Path
from typing import Any

import pytest

from pincette.cli import CliError
from pincette.cli.terminal import RigOption
from pincette.config import RigFile
from pincette_study import command as paper
from pincette_study.closed_loop import StudyError
from pincette_study.study import Progress
from tests.support.rigs import DEMO, demo_rig, rig_toml


def test_a_rig_that_is_not_simulated_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_toml(demo_rig().model_copy(update={"simulation": None})), encoding="utf-8")
    with pytest.raises(CliError, match=r"rig.toml has no \[simulation\]"):
        paper.paper(RigOption(path), tmp_path, 1)


def test_at_least_one_random_rig_is_required(tmp_path: Path) -> None:
    with pytest.raises(CliError, match="--rigs = 0: must be at least 1"):
        paper.paper(RigOption(DEMO), tmp_path, 0)
    with pytest.raises(CliError, match="--beyond-rigs = 0: must be at least 1"):
        paper.paper(RigOption(DEMO), tmp_path, 1, 0)


def test_progress_and_summary_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def study(
        rig: RigFile,
        folder: Path,
        progress: Progress,
        rigs: int,
        beyond: int,
        fast: RigFile,
        fast_rigs: int,
        workers: int,
    ) -> dict[str, Any]:
        assert (rig.rig.name, folder, rigs, beyond) == ("demo", tmp_path, 3, 2)
        assert (fast.rig.name, fast_rigs) == ("kilohertz", 4)
        assert 1 <= workers <= paper.MOST_WORKERS
        progress("stability map", 0.25)
        return {"random_rigs": rigs, "table1_force_percent": {"5": 2.8149, "2": 5.78}}

    monkeypatch.setattr("pincette_study.study.run_study", study)
    assert paper.paper(RigOption(DEMO), tmp_path, 3, 2, 4) == 0
    output = capsys.readouterr().out
    assert "25 %  stability map" in output
    assert "random_rigs: 3" in output
    assert "table1_force_percent: 5 2.81, 2 5.78" in output
    assert "index.html" in output


def test_an_interrupted_study_reports_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def study(*_: object) -> dict[str, Any]:
        raise StudyError("no track: ended 'no_contact'")

    monkeypatch.setattr("pincette_study.study.run_study", study)
    with pytest.raises(CliError, match="could not be finished: no track: ended 'no_contact'"):
        paper.paper(RigOption(DEMO), tmp_path, 1)
