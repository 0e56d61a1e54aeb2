"""A series at a rig of real processes: by command line and REST, through a killed supervisor."""

import subprocess
import sys
from pathlib import Path
from time import monotonic, sleep

from pincette.client import Supervisor
from tests.support.grips import kill, make_ready, restart
from tests.support.running import RunningRig

LONG_S = 120.0
"""A rig in lockstep is as slow as the machine is loaded."""
PLAN = """
name = "beads"
after_restart = "continue"
csv_file = "beads.csv"

[job]
kind = "grip"
"""
BEADS = "sample,force_mN\nB1,8\nB2,9\nB3,10\n"


def test_a_series_continues_with_the_next_supervisor(lockstep: RunningRig, tmp_path: Path) -> None:
    rig = lockstep
    make_ready(rig, LONG_S)
    (tmp_path / "plan.toml").write_text(PLAN, encoding="utf-8")
    (tmp_path / "beads.csv").write_text(BEADS, encoding="utf-8")
    url = rig.rig.supervisor.url
    words = [sys.executable, "-m", "pincette", "series"]
    requested = [*words, "run", str(tmp_path / "plan.toml"), "--url", url]
    with subprocess.Popen(requested, stdout=subprocess.PIPE, text=True) as typed:
        try:
            deadline_s = monotonic() + LONG_S
            while not (rig.get("/series")["series"] or [{"ended": 0}])[0]["ended"]:
                assert monotonic() < deadline_s
                sleep(0.1)
            kill(rig, "supervisor")
            restart(rig, "supervisor")
            output, _ = typed.communicate(timeout=LONG_S)
        finally:
            typed.kill()
    assert typed.returncode == 0, output
    assert "3 of 3 ended" in output
    with Supervisor(url) as supervisor:
        (summary,) = supervisor.series()
        series = supervisor.find_series(summary.id)
        assert series.wait(LONG_S).state == "completed"
        assert [one.request["sample"] for one in series.series.jobs] == ["B1", "B2", "B3"]
        assert [one.state for one in series.series.jobs] == ["succeeded"] * 3
        forces = [job.job.values["force_mN"] for job in series.jobs() if job.state == "succeeded"]
        assert forces == [10.0, 9.0, 8.0]
    table, report = tmp_path / "beads.parquet", tmp_path / "beads.html"
    saved = [*words, "show", "--out", str(table), "--report", str(report), "--url", url]
    subprocess.run(saved, check=True, timeout=LONG_S)
    assert table.read_bytes().startswith(b"PAR1")
    assert "within U" in report.read_text(encoding="utf-8")

    body = {"rig": "demo", "job": {"kind": "grip"}, "grid": {"force_mN": [8.0]}}
    posted = rig.post("/series", body).raise_for_status().json()
    with Supervisor(url) as supervisor:
        assert supervisor.find_series(posted["id"]).wait(LONG_S).state == "completed"
    found = rig.get(f"/series/{posted['id']}")
    assert [one["state"] for one in found["jobs"]] == ["succeeded"]
