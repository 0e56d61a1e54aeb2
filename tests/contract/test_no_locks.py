"""Real programs whose data folder lies on a file system without locks are refused and damage
nothing."""

import errno
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.no_locks import environment, library, objection
from tests.support.rigs import demo_rig, rig_toml

NUMBERS = {name: getattr(errno, name) for name in ("ENOLCK", "EOPNOTSUPP", "EBADF", "EIO")}
TOO_LONG_S = 120.0
Run = Callable[..., subprocess.CompletedProcess[str]]

OPEN_PORT = """
import sys
from pincette.instruments.link import open_link
from pincette.instruments.protocols import InstrumentError
try:
    open_link(sys.argv[1], baud=115200, timeout_s=1.0)
except InstrumentError as error:
    sys.exit(str(error))
"""


@pytest.fixture(scope="module")
def preloaded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if reason := objection():
        pytest.skip(reason)
    return library(tmp_path_factory.mktemp("library"))


@pytest.fixture(params=NUMBERS)
def share(request: pytest.FixtureRequest, preloaded: Path, tmp_path: Path) -> tuple[Path, Run]:
    """Provide a folder without locks, and a function that runs a program that sees it in this
    way."""
    folder = tmp_path / "share"
    folder.mkdir()
    variables = environment(preloaded, folder, NUMBERS[request.param])

    def run(*words: str | Path, locks: bool = False) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, *map(str, words)]
        return subprocess.run(
            command,
            env=None if locks else variables,
            capture_output=True,
            text=True,
            timeout=TOO_LONG_S,
            check=False,
        )

    return folder, run


PINCETTE = ("-m", "pincette")


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_without_file_locks_every_program_reports_path_and_remedy_and_changes_nothing(
    share: tuple[Path, Run], tmp_path: Path
) -> None:
    folder, run = share
    data, rig = folder / "data", tmp_path / "rig.toml"
    rig.write_text(rig_toml(demo_rig()), encoding="utf-8")
    made = run(*PINCETTE, "key", "add", "ann", "--data", data, locks=True)
    assert made.returncode == 0, made.stderr
    before = content(data)
    backup = folder / "bench.tar.gz"
    for words in (
        ("key", "add", "ben", "--data", data),
        ("key", "revoke", "ann", "--data", data),
        ("run", "supervisor", "--rig", rig, "--data", data),
        ("backup", backup, "--data", data),
    ):
        refused = run(*PINCETTE, *words)
        assert refused.returncode not in (0, None), words
        assert "Traceback" not in refused.stderr
        assert str(data) in refused.stderr
        assert "local disk" in refused.stderr
        assert "move it away" not in refused.stderr
        assert not backup.exists()
    after = content(data)
    assert {name: after[name] for name in before} == before
    listed = run(*PINCETTE, "key", "list", "--data", data, locks=True)
    assert (listed.returncode, "ann" in listed.stdout, "ben" in listed.stdout) == (0, True, False)


def test_a_backup_can_be_written_to_a_share_without_locks(
    share: tuple[Path, Run], tmp_path: Path
) -> None:
    folder, run = share
    data, backup = tmp_path / "data #1?", folder / "bench.tar.gz"
    assert run(*PINCETTE, "key", "add", "ann", "--data", data).returncode == 0
    written = run(*PINCETTE, "backup", backup, "--data", data)
    assert written.returncode == 0, written.stderr
    restored = run(*PINCETTE, "restore", backup, "--data", tmp_path / "again")
    assert restored.returncode == 0, restored.stderr


def test_a_port_that_cannot_be_locked_is_not_opened(share: tuple[Path, Run]) -> None:
    # The name of a pseudo-terminal is below /dev/pts, and its locks are ordinary file locks.
    folder, run = share
    device = folder / "ttyUSB0"
    device.touch()
    refused = run("-c", OPEN_PORT, device)
    assert refused.returncode == 1, refused.stderr
    assert str(device) in refused.stderr
    assert "Traceback" not in refused.stderr
