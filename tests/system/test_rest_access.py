"""The supervisor as a program: its start, its access control, and no keys in any file."""

import subprocess
from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from time import monotonic, sleep

import httpx
import pytest

from pincette.api.access import Scope
from pincette.config import RigFile
from pincette_supervisor.access.access import Access, KeySync
from pincette_supervisor.access.key_store import open_keys
from pincette_supervisor.rest.api import create_app
from tests.support.commands import PINCETTE, pincette
from tests.support.grips import SHORT, make_ready
from tests.support.keys import shown
from tests.support.rigs import demo_rig, free_ports, paced_rig, rig_toml
from tests.support.running import RunningRig, running_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

KNOWN_S = 10.0
"""Time within which a running supervisor uses changes made on the command line, in s; one second
is documented."""
LONG_S = 180.0
"""Longest time of a command on a busy machine, in s."""


def made(data: Path, name: str, scope: Scope) -> str:
    """Make a key with the command line, with or without a running supervisor."""
    with open_keys(data) as keys:
        return keys.add(name, scope, None)[0]


def status(client: httpx.Client, headers: dict[str, str] | None = None) -> int:
    return client.get("/rigs", headers=headers).status_code


def until(wanted: int, client: httpx.Client, headers: dict[str, str] | None = None) -> None:
    begun_s = monotonic()
    while status(client, headers) != wanted:
        assert monotonic() - begun_s < KNOWN_S, f"no {wanted} within {KNOWN_S:g} s"
        sleep(0.05)


def started(rig: RigFile, folder: Path) -> subprocess.CompletedProcess[str]:
    """Start a supervisor that is expected to refuse to start."""
    path = folder / "rig.toml"
    path.write_text(rig_toml(rig), encoding="utf-8")
    command = [*PINCETTE, "run", "supervisor", "--rig", str(path), "--data", str(folder / "data")]
    return subprocess.run(command, capture_output=True, text=True, timeout=LONG_S, check=False)


def test_the_supervisor_does_not_start_if_others_can_reach_it_without_a_key(tmp_path: Path) -> None:
    made(tmp_path / "data", "gone", "admin")
    revoke(tmp_path / "data", "gone")
    done = started(demo_rig({"supervisor": {"host": "0.0.0.0"}}), tmp_path)
    assert done.returncode == 2
    assert "other machines can reach 0.0.0.0" in done.stderr
    assert "pincette key add NAME" in done.stderr


def revoke(data: Path, name: str) -> None:
    with open_keys(data) as keys:
        assert keys.revoke(name)


def test_keys_are_required_as_soon_as_one_exists_and_no_file_contains_them(tmp_path: Path) -> None:
    """The journal's thread, the HTTP server and the command line are real; the rig is simulated."""
    desk, access = Harness(demo_rig(time="lockstep"), tmp_path), Access()
    desk.app = create_app(desk.rigs, access)
    with (
        closing(desk),
        closing(KeySync(desk.store, access)),
        served(desk.app) as address,
        httpx.Client(base_url=f"{address}/api/v1", trust_env=False, timeout=LONG_S) as client,
    ):
        _keys_come_and_go(client, address, tmp_path)
    written = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    assert b"pincette_" not in written


def _keys_come_and_go(client: httpx.Client, address: str, data: Path) -> None:
    assert status(client) == 200
    seer, operator = made(data, "seer", "observe"), made(data, "cell-7", "operate")
    boss = made(data, "boss", "admin")
    until(401, client)
    # The keys were made one after another, and the supervisor may have read the file in between.
    for key in (seer, operator, boss):
        until(200, client, shown(key))
    assert client.get(f"/rigs?key={seer}").status_code == 401

    body = {"kind": "grip", "autostart": True}
    assert client.post("/jobs", json=body, headers=shown(seer)).status_code == 403
    labelled = {**shown(operator), "X-Operator": "Ann"}
    job = client.post("/jobs", json=body, headers=labelled)
    assert (job.status_code, job.json()["by"]) == (201, "cell-7 (Ann)")

    refused = pincette(
        "job", "grip", "--no-wait", "--url", address, "--key", seer, timeout_s=LONG_S
    )
    assert refused.returncode == 1
    assert "needs scope operate" in refused.stderr
    assert "key 'seer' has observe" in refused.stderr
    audited = pincette("audit", "--json", "--url", address, "--key", boss, timeout_s=LONG_S)
    assert '"who": "cell-7 (Ann)"' in audited.stdout
    assert '"status": 403' in audited.stdout

    revoke(data, "seer")
    until(401, client, shown(seer))
    assert status(client, shown(operator)) == 200


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    folder = tmp_path_factory.mktemp("rig")
    with running_rig(paced_rig(SHORT), folder) as running:
        make_ready(running)
        yield running


def test_requests_to_a_running_rig_need_a_key_but_a_stop_does_not(rig: RunningRig) -> None:
    """A stop without a supervisor is tested in test_security.py, with real programs."""
    seer = made(rig.data, "seer", "observe")
    until(401, rig.client)
    until(200, rig.client, shown(seer))
    place = ("estop", "--rig", rig.path)
    for key in ((), ("--key", seer), ("--key", "pincette_wrong")):
        done = pincette(*place, *key, timeout_s=LONG_S)
        assert done.returncode == 0, done.stderr
    answer = rig.client.get("/rigs/demo", headers=shown(seer))
    assert answer.status_code == 200, answer.text
    view = answer.json()
    assert view["latch"]["cause"] == "estop"


@pytest.mark.full
def test_a_second_supervisor_of_a_running_rig_does_not_start(
    rig: RunningRig, tmp_path: Path
) -> None:
    """The second supervisor has another port and folder; the first one continues."""
    path = tmp_path / "rig.toml"
    other = rig.rig.model_copy(
        update={"supervisor": rig.rig.supervisor.model_copy(update={"port": free_ports(1)})}
    )
    path.write_text(rig_toml(other), encoding="utf-8")
    command = [*PINCETTE, "run", "supervisor", "--rig", str(path), "--data", str(tmp_path / "data")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONG_S, check=False)
    assert done.returncode != 0
    assert "another supervisor already serves rig demo" in done.stderr
    assert rig.client.get("/rigs/demo").status_code in (200, 401)
