"""``make findings`` runs every script of the folder, and fails if one fails."""

import os
import stat
import subprocess
from pathlib import Path


def make_findings(root: Path, folder: Path) -> "subprocess.CompletedProcess[str]":
    makefile = root / "Makefile"
    words = ["make", "--no-print-directory", "-f", str(makefile), "findings"]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)


def test_all_scripts_are_run_one_after_another(root: Path, tmp_path: Path) -> None:
    (tmp_path / "findings").mkdir()
    (tmp_path / "findings" / "a.sh").write_text("echo first; exit 3\n", encoding="utf-8")
    (tmp_path / "findings" / "b.sh").write_text("echo second\n", encoding="utf-8")
    done = make_findings(root, tmp_path)
    assert done.returncode != 0
    assert done.stdout.split() == ["==", "findings/a.sh", "first", "==", "findings/b.sh", "second"]
    assert "findings/a.sh" in done.stderr
    (tmp_path / "findings" / "a.sh").unlink()
    assert make_findings(root, tmp_path).returncode == 0


def test_each_script_can_be_run_alone(root: Path) -> None:
    scripts = sorted((root / "findings").glob("*.sh"))
    assert len(scripts) > 2
    for script in scripts:
        assert script.read_text(encoding="utf-8").startswith("#!/usr/bin/env bash\n# ")
        assert stat.S_IMODE(script.stat().st_mode) & stat.S_IXUSR
        syntax = subprocess.run(["bash", "-n", str(script)], check=False)
        assert syntax.returncode == os.EX_OK, script
