"""A vision client as a separate program, and a job that uses its position: REST, CLI and client."""

import subprocess
import sys
from pathlib import Path
from time import monotonic, sleep

import pytest

from pincette.client import Supervisor
from tests.support.checkout import ROOT, environment
from tests.support.grips import make_ready
from tests.support.running import RunningRig

PATIENCE_S = 120.0


def test_a_grip_uses_the_place_that_the_example_publishes(lockstep: RunningRig) -> None:
    rig, bus = lockstep, lockstep.rig.bus
    make_ready(rig, PATIENCE_S)
    words = ["--router", f"tcp/{bus.host}:{bus.port}", "--x-um", "6.0", "--u-um", "0.8"]
    camera = subprocess.Popen(
        [sys.executable, str(ROOT / "docs/examples/place.py"), *words], env=environment()
    )
    try:
        deadline = monotonic() + PATIENCE_S
        while not rig.get("/rigs/demo/places")["newest"]:
            assert camera.poll() is None
            assert monotonic() < deadline
            sleep(0.1)
        ended = rig.ended(rig.start_grip(place={"given_by": "bus", "max_age_s": 600.0}), PATIENCE_S)
        url = str(rig.client.base_url).removesuffix("/").removesuffix("/api/v1")
        command = [str(Path(sys.executable).with_name("pincette")), "job", "grip"]
        command += ["--all", "--url", url, "--place", "given_by=bus,source=camera-1,max_age_s=600"]
        completed = subprocess.run(
            command, env=environment(), capture_output=True, text=True, timeout=PATIENCE_S
        )
        with Supervisor(url) as supervisor:
            places = supervisor.rig("demo").places()
    finally:
        camera.terminate()
        camera.wait(10.0)
    assert ended["state"] == "succeeded"
    found = ended["result"]["place"]
    assert found["difference_um"] == pytest.approx(0.2, abs=0.3)
    assert abs(found["difference_um"]) < found["uncertainty_um"]
    assert completed.returncode == 0, completed.stdout + completed.stderr
    assert "place found minus place given" in completed.stdout
    (bias,) = places.biases
    assert bias.count == 2
    assert bias.mean_um == pytest.approx(found["difference_um"], abs=0.1)
