"""With deploy/secure.yml the programs use mutual TLS, and a subscriber needs a certificate."""

import subprocess
import tarfile
from collections.abc import Generator
from io import BytesIO
from pathlib import Path

import pytest

from tests.support.checkout import ROOT, await_text, until_interrupted
from tests.support.contained import contained
from tests.support.engine import Project, docker, told, up
from tests.support.engine_rig import ContainerRig, mounting, reached, short_rig
from tests.support.engine_stalls import ContainerStalls
from tests.support.grips import make_ready

PYTHON = str(ROOT / ".venv/bin/python")
NAME = "pincette-secure"
MADE = "/pki/made"
QUIET_S = 3.0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[ContainerRig]:
    folder, short = tmp_path_factory.mktemp("secure"), short_rig()
    with (
        up(Project(NAME, "listen", "secure", mounting(short, folder))) as project,
        reached(project, short, folder) as running,
    ):
        yield running


def test_a_grip_over_mutual_tls(rig: ContainerRig, stalls: ContainerStalls) -> None:
    make_ready(rig)
    ended = rig.ended(rig.start_grip())
    assert ended["state"] == "succeeded", f"{ended['cause']}\n{stalls.stalls[-5:]}"


def test_no_program_has_the_key_of_the_authority(rig: ContainerRig) -> None:
    project = rig.containers.project
    for name in contained():
        listed = project.compose("exec", "-T", name, "cat", f"{MADE}/authority.key")
        assert "No such file" in listed.stdout, name
        written = project.compose("exec", "-T", name, "sh", "-c", f"echo > {MADE}/x")
        assert "Read-only file system" in written.stdout, name
    assert "authority.key" in told(
        "run", "--rm", "-v", f"{NAME}_authority:/a", "--entrypoint", "ls", "pincette", "/a"
    )


def test_clients_without_a_certificate_receive_nothing(rig: ContainerRig, tmp_path: Path) -> None:
    assert rig.view()["programs"]
    plain = ROOT / "docs/examples/subscribe.py"
    log = tmp_path / "plain.log"
    with (
        until_interrupted([PYTHON, str(plain)], tmp_path, log) as process,
        pytest.raises(TimeoutError),
    ):
        await_text(log, " V\n", process, QUIET_S)


def test_a_viewer_receives_messages_of_the_rig(rig: ContainerRig, tmp_path: Path) -> None:
    project = rig.containers.project
    issue = f"pincette security issue {MADE} anna --role viewer"
    done = project.compose("run", "--rm", "-T", "certificates", issue)
    assert done.returncode == 0, done.stdout
    done = project.compose("restart", "router")
    assert done.returncode == 0, done.stdout
    rig.containers.until_healthy()
    image = [
        "docker",
        "run",
        "--rm",
        "-v",
        f"{NAME}_pki:/pki:ro",
        "--entrypoint",
        "tar",
        "pincette",
    ]
    files = ["authority.crt", "anna.crt", "anna.key"]
    packed = subprocess.run(
        [*image, "-C", MADE, "-cf", "-", *files], capture_output=True, timeout=60.0, check=True
    )
    with tarfile.open(fileobj=BytesIO(packed.stdout)) as archive:
        archive.extractall(tmp_path, filter="data")
    log = tmp_path / "anna.log"
    script = str(ROOT / "docs/examples/secure/subscribe.py")
    command = [PYTHON, script, "--pki", str(tmp_path), "--identity", "anna"]
    with until_interrupted(command, tmp_path, log) as process:
        assert " V" in await_text(log, " V\n", process, 20.0)


def test_certificates_are_made_once(rig: ContainerRig) -> None:
    """After another start the programs keep the certificates that they have."""
    digest = ("run", "--rm", "-v", f"{NAME}_pki:/pki:ro", "--entrypoint", "md5sum", "pincette")
    before = told(*digest, f"{MADE}/authority.crt")
    rig.containers.project.up("--force-recreate")
    assert told(*digest, f"{MADE}/authority.crt") == before
    assert docker("inspect", f"{NAME}-certificates-1").returncode == 0
