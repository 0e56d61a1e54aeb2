"""From an uncalibrated rig to a grip, with `pincette bring-up` only."""

import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from pincette.config import read_rig
from tests.support.rigs import DEMO, at_own_ports
from tests.support.running import RunningRig, running_rig

QUICK = {"rig": {"time": "lockstep"}, "grip": {"hold_s": 1.0, "load_s": 1.0}}


@pytest.fixture
def rig(tmp_path: Path) -> Generator[RunningRig]:
    bench = at_own_ports(read_rig(DEMO.with_name("bring-up.toml")), QUICK)
    with running_rig(bench, tmp_path) as running:
        yield running


def test_a_script_brings_up_a_rig_with_instructions_for_the_bench(
    rig: RunningRig,
) -> None:
    supervisor = rig.rig.supervisor
    url = ["--url", f"http://{supervisor.host}:{supervisor.port}"]
    bring_up = ["bring-up", "--yes", "--skip", "compliance", *url]

    assert typed("rig", "part", "remove", "--rig", str(rig.path)).returncode == 0
    stopped = typed(*bring_up)
    assert stopped.returncode == 1, stopped.stderr
    assert "contact stiffness: put the part in place" in stopped.stdout
    steps = {step["calibration"]: step for step in rig.get(checklist(rig))["steps"]}
    assert [steps[name]["state"] for name in ("noise", "free_response")] == ["done", "done"]
    assert steps["contact_stiffness"]["state"] == "later"

    assert typed("rig", "part", "place", "--rig", str(rig.path)).returncode == 0
    done = typed(*bring_up)
    assert done.returncode == 0, done.stderr
    assert "skipped: compliance" in done.stdout
    assert rig.get(checklist(rig))["next"] == "compliance"
    assert typed("job", "grip", "--force-mN", "10", *url).returncode == 0


def typed(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command as a script does."""
    command = [sys.executable, "-m", "pincette", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


def checklist(rig: RunningRig) -> str:
    return f"/rigs/{rig.rig.rig.name}/checklist"
