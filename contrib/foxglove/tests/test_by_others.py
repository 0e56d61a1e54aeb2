"""The TypeScript client of the protocol receives samples of a rig, and Rerun accepts a record."""

import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from contrib.support.npm import node as run_node
from contrib.support.npm import npm_folder
from tests.support.adapters import FORCE_MN, adapter_rig, ports_of_adapters
from tests.support.grips import make_ready
from tests.support.running import RunningRig

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parent / "foxglove_ts/watch.js"
PACKAGES = ("@foxglove/ws-protocol@0.8.0", "protobufjs@7", "ws@8")


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    place = tmp_path_factory.mktemp("foxglove")
    with adapter_rig(place, ports_of_adapters(), ["foxglove"]) as running:
        make_ready(running)
        yield running


def test_the_client_in_typescript_decodes_samples(rig: RunningRig, tmp_path: Path) -> None:
    folder = npm_folder(tmp_path, SCRIPT, *PACKAGES)
    job = rig.start_grip(until_released=True, force_mN=FORCE_MN)
    rig.until_phase(job, "hold")
    address = f"ws://127.0.0.1:{rig.rig.foxglove.port}"
    output = run_node(folder, SCRIPT.name, address, "estimate", "20")
    assert output["name"] == "pincette demo"
    assert output["channels"]["estimate"] == "pincette.Estimate"
    key = next(name for name in output["seen"][0] if name.replace("_", "").lower() == "forcemn")
    assert output["seen"][-1][key] == pytest.approx(FORCE_MN, abs=2.0)
    rig.post(f"/jobs/{job}/actions", {"type": "release"}).raise_for_status()
    rig.ended(job)


def test_rerun_reads_a_record(rig: RunningRig) -> None:
    job = rig.ended(rig.start_grip(force_mN=FORCE_MN))
    record = Path(job["record"]) / "job.mcap"
    script = str(Path(sys.executable).with_name("rerun"))
    line = [script, "mcap", "check", str(record)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120.0, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
