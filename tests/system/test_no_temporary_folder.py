"""A secure rig works, and admits new clients, on a machine whose temporary folders are full."""

import os
import subprocess
from pathlib import Path
from time import monotonic

import httpx
import pytest

from pincette.client import Supervisor
from tests.support.checkout import ROOT, await_text, until_interrupted
from tests.support.commands import PINCETTE
from tests.support.grips import SHORT
from tests.support.rigs import paced_rig, rig_toml

START_S = 120.0
FULL = """
set -e
mount --bind "$1" /mnt
mount -t tmpfs -o size=4k full "/tmp"
mount --bind /tmp /var/tmp
dd if=/dev/zero of=/tmp/ballast bs=4096 2> /dev/null || true
cd /proc
shift
exec "$@"
"""
"""Script that fills every folder that Python uses as a temporary one; the first argument is
mounted at /mnt."""


def with_full_folders(kept: Path) -> list[str]:
    """Return the arguments before a command; skips, and prints why, if full folders are not
    possible."""
    words = ["unshare", "--mount", "sh", "-c", FULL, "sh", str(kept)]
    probe = "import tempfile\ntry: tempfile.mkdtemp()\nexcept OSError: print('full')"
    tried = subprocess.run(
        [*words, PINCETTE[0], "-c", probe], capture_output=True, text=True, check=False
    )
    if tried.returncode:
        pytest.skip(f"no temporary folder can be made full here: {tried.stderr.strip()}")
    assert tried.stdout == "full\n"
    return words


def test_operators_can_stop_the_rig_without_a_temporary_folder(tmp_path: Path) -> None:
    rig = paced_rig(SHORT)
    (tmp_path / "rig.toml").write_text(rig_toml(rig), encoding="utf-8")
    within = ["--rig", "/mnt/rig.toml", "--data", "/mnt/data"]
    words, log = with_full_folders(tmp_path), tmp_path / "up.log"
    pki = os.environ | {"PINCETTE_PKI": "/mnt/data/pki", "PYTHONPATH": str(ROOT)}
    with until_interrupted([*words, *PINCETTE, "up", "--secure", *within], ROOT, log) as process:
        await_text(log, "is up at", process, START_S)
        with Supervisor(rig.supervisor.url, timeout_s=60.0, patience_s=START_S) as supervisor:
            desk = supervisor.rig("demo")
            job = desk.start("grip", until_released=True)
            while "release" not in job.refresh(0.2).allowed_actions:
                assert not job.ended
            until_s = monotonic() + START_S
            # This is the operator's first session. The supervisor is not used.
            stop = [*PINCETTE, "estop", "--rig", "/mnt/rig.toml", "--url", "http://127.0.0.1:1"]
            done = subprocess.run(
                [*words, *stop], env=pki, capture_output=True, text=True, check=False, timeout=60.0
            )
            assert done.returncode == 0, done.stdout + done.stderr
            while job.refresh(0.5).artifacts == "being_written" or not desk.state().latch.cause:
                assert monotonic() < until_s
            assert desk.state().latch.cause == "estop"
            assert any(one.name.endswith(".png") for one in job.artifacts())
            url = f"{rig.supervisor.url}/api/v1/jobs/export.parquet"
            assert httpx.get(url, trust_env=False, timeout=60.0).content.endswith(b"PAR1")
