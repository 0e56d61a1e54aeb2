"""A stock Tiled server lists the samples of a flight, and its stock client reads them back."""

import json
import os
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pyarrow.parquet as untyped_parquet
import pytest

from tests.support.adapters import FORCE_MN, NEAR_MN, until
from tests.support.checkout import ROOT
from tests.support.environments import environment, ran, wheel
from tests.support.rigs import free_ports
from tests.support.running import RunningRig

# Its environment is made for it: Tiled wants an older sqlalchemy than pincette has.
pytestmark = pytest.mark.slow

parquet: Any = untyped_parquet
DRIVE = ROOT / "contrib/support/tiled_drive.py"
WANTED = ("tiled[server]>=0.2.20", "bluesky-tiled-plugins>=2.0.12")
KEY = "secret"


@contextmanager
def tiled(python: Path, folder: Path) -> Generator[str]:
    """The address of a server with an empty catalog."""
    port, log = free_ports(1), folder / "tiled.log"
    line = [str(python.with_name("tiled")), "serve", "catalog", "--temp", "--api-key", KEY]
    with (
        log.open("wb") as sink,
        subprocess.Popen(
            [*line, "--port", str(port)],
            cwd=folder,
            env={**os.environ, "HOME": str(folder)},
            stdout=sink,
            stderr=subprocess.STDOUT,
        ) as process,
    ):
        address = f"http://127.0.0.1:{port}"

        def answers() -> bool:
            assert process.poll() is None, log.read_text(errors="replace")[-3000:]
            try:
                return httpx.get(f"{address}/healthz", trust_env=False).is_success
            except httpx.TransportError:
                return False

        try:
            until(answers, "Tiled does not start", 120.0)
            yield address
        finally:
            process.terminate()
            process.wait(20.0)


def test_a_flight_is_listed_with_its_samples_and_units(rig: RunningRig, tmp_path: Path) -> None:
    own = (str(wheel("shared")), str(wheel("contrib/bluesky")))
    python = environment(tmp_path / "venv", *own, *WANTED)
    with tiled(python, tmp_path) as address:
        line = [str(python), str(DRIVE), rig.rig.supervisor.url, address, KEY, str(FORCE_MN)]
        found = json.loads(ran(line, tmp_path).splitlines()[-1])
    assert found["start"]["sample"] == "bead"
    assert found["stop"]["exit_status"] == "success"
    assert found["streams"] == ["samples"]
    assert found["keys"]["gripper-force_mN"]["units"] == "mN"
    assert set(found["listed"]) >= set(found["keys"])
    (job,) = rig.get("/jobs", label="bluesky=gripper")["jobs"]
    kept = parquet.read_table(Path(rig.ended(job["id"])["record"]) / "samples.parquet").to_pydict()
    assert found["phase"] == kept["phase"]
    assert found["force_mN"] == pytest.approx(kept["force_mN"], nan_ok=True)
    held = [
        one for one, phase in zip(found["force_mN"], found["phase"], strict=True) if phase == "hold"
    ]
    assert held[-1] == pytest.approx(FORCE_MN, abs=NEAR_MN)
