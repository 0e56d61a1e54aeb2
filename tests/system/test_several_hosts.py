"""A rig on one host, its supervisor on another: a grip, a cable that is pulled, all found again.

The hosts are networks of their own, with clocks that have nothing to do with each other.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.namespaces import alone, objection
from tests.support.two_hosts import LEASE_S

pytestmark = pytest.mark.usefixtures("stalls")

TRY_S = 400.0
SLACK_S = 1.0
"""What a stop and a busy machine may add to a lease; a renewal under way may be just as old."""


@pytest.mark.slow
@pytest.mark.parametrize("words", [[], ["--secure"]], ids=["plain", "mutual TLS"])
def test_a_cut_stops_the_job_by_its_lease_and_a_healed_link_is_found_again(
    words: list[str], tmp_path: Path
) -> None:
    if why := objection():
        pytest.skip(why)
    command = [sys.executable, "-m", "tests.support.two_hosts", str(tmp_path), *words]
    ran = subprocess.run(alone(command), capture_output=True, text=True, timeout=TRY_S, check=False)
    assert ran.returncode == 0, ran.stderr
    told: dict[str, Any] = json.loads(ran.stdout)
    for grip in told["grips"]:
        assert (grip["state"], grip["record_complete"]) == ("succeeded", True), grip
    heard = told["while_cut"]
    (stopped,) = [one for one in heard if one.get("acted") == "lease stop"]
    assert 0.0 < stopped["at_s"] - told["cut_s"] < LEASE_S + SLACK_S
    assert not [one for one in heard if one.get("state") in ("frozen", "ramping", "latched")]
    assert told["held_job"]["state"] == "failed"
    assert "actuator: silent" in told["held_job"]["cause"]
    rig = told["rig"]
    assert rig["part"] == "held"
    assert all(one["alive"] and not one["trouble"] for one in rig["programs"])
