"""A data sheet from a rig with all its programs: by command line, over REST, as files."""

import json
import subprocess
import sys
from pathlib import Path

from pincette.client import Supervisor
from tests.support.grips import make_ready
from tests.support.running import RunningRig

LONG_S = 500.0


def test_the_command_measures_and_saves_a_data_sheet(lockstep: RunningRig, tmp_path: Path) -> None:
    rig = lockstep
    make_ready(rig, 60.0)
    kinds = {kind["name"]: kind for kind in rig.get("/kinds")["kinds"]}
    form = [field["name"] for field in kinds["characterise"]["form"]]
    assert {"force_mN", "noise_s", "grips"} <= set(form)
    url = f"http://{rig.rig.supervisor.host}:{rig.rig.supervisor.port}"
    words = [
        "data-sheet",
        "--noise",
        "2",
        "--grips",
        "2",
        "--out",
        str(tmp_path / "sheet"),
        "--url",
        url,
    ]
    ended = subprocess.run(
        [sys.executable, "-m", "pincette", *words],
        capture_output=True,
        text=True,
        timeout=LONG_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    (job,) = rig.get("/jobs", limit=1)["jobs"]
    assert (job["kind"], job["state"], job["cause"]) == ("characterise", "succeeded", "")
    files = {file["name"]: file for file in rig.get(f"/jobs/{job['id']}/artifacts")["artifacts"]}
    assert files["datasheet.html"]["media_type"].startswith("text/html")
    assert files["datasheet.json"]["media_type"] == "application/json"
    assert len(files) == len(rig.get(f"/jobs/{job['id']}/artifacts")["artifacts"])
    sheet = json.loads((tmp_path / "sheet/datasheet.json").read_text(encoding="utf-8"))
    result = rig.get(f"/jobs/{job['id']}")["result"]
    assert sheet["values"] == result["values"]
    assert sheet["about"]["date"] == job["started_at"][:10]
    assert {value["quantity"] for value in sheet["values"]} >= {
        "free_stroke",
        "force_noise_all",
        "zero_return_scatter",
    }
    printed = (tmp_path / "sheet/datasheet.pdf").read_bytes()
    assert printed.startswith(b"%PDF")
    with Supervisor(url) as supervisor:
        handle = supervisor.job(job["id"])
        assert (handle.job.result or {})["values"] == result["values"]
        assert handle.download("datasheet.pdf", tmp_path).read_bytes() == printed
