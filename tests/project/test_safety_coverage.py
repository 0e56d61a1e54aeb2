"""Every branch of the safety module, and of the actuator around it, is covered by a unit test."""

import json
import subprocess
import sys
from pathlib import Path

SOURCES = ("shared/pincette/control/safety", "services/actuator/pincette_actuator")
TESTS = ("tests/unit/control/safety", "tests/unit/actuator")


def test_every_branch_is_covered_by_unit_tests(root: Path, tmp_path: Path) -> None:
    coverage = [sys.executable, "-m", "coverage"]
    data, report = f"--data-file={tmp_path / 'data'}", tmp_path / "report.json"
    sources = f"--source={','.join(SOURCES)}"
    pytest = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow", *TESTS]
    subprocess.run([*coverage, "run", data, "--branch", sources, *pytest], cwd=root, check=True)
    reported = ["json", data, "--fail-under=0", "-q", "-o", str(report)]
    subprocess.run([*coverage, *reported], cwd=root, check=True)
    files = json.loads(report.read_text(encoding="utf-8"))["files"]
    assert len(files) >= 12
    assert {
        name: (file["missing_lines"], file["missing_branches"])
        for name, file in files.items()
        if file["missing_lines"] or file["missing_branches"]
    } == {}
