"""Data reported as stored survive a power cut at that moment, and are not accessible to other
accounts."""

import hashlib
import os
import stat
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from pincette.cli.main import main
from pincette.cli.output_file import write_output
from pincette.client.streaming import Download
from pincette.config import Calibration
from pincette.core.faults import Predecessor
from pincette.engine import log_files
from pincette.engine.boot_note import Before, BootNote
from pincette.engine.process import keep_from_others
from pincette.security.establishing import establish
from pincette.security.folder import Folder, checked
from pincette.security.identity import person, program
from pincette.security.revocation import read_revoked
from pincette_supervisor.journal.access import KeyFile
from pincette_supervisor.journal.store import Store
from pincette_supervisor.model import ModelFiles, StoredModel
from tests.support.durable import Durable

NOW = datetime(2013, 4, 1, 12, tzinfo=UTC)


class Disk:
    """A folder, and what a power cut would leave of it."""

    def __init__(self, durable: Durable, folder: Path) -> None:
        self.root, self._durable, self._left = folder / "root", durable, folder / "left"
        self.root.mkdir()

    def cut(self) -> Path:
        return self._durable.cut(self.root, self._left)


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(Durable(monkeypatch), tmp_path)


@pytest.fixture
def mask() -> Iterator[None]:
    before = os.umask(0o022)
    yield
    os.umask(before)


def test_certificates_keys_and_the_revocation_list_survive_a_power_cut(disk: Disk) -> None:
    folder = Folder(disk.root / "pki")
    establish(folder, ["demo"], [], NOW, 100.0)
    operator = person("operator", "operator")
    serial = folder.facts(operator).serial
    folder.revoke(operator)
    folder.renew(program("sensor", "demo"), NOW, 50.0)
    left = Folder(disk.cut() / "pki")
    assert read_revoked(left.path) == {serial}
    names = {facts.identity.name for facts in left.all()}
    assert names == {facts.identity.name for facts in folder.all()} >= {"router", "demo/sensor"}
    for facts in left.all():
        checked(left.credentials(facts.identity), NOW)


def test_keys_of_the_supervisor_survive_a_power_cut(disk: Disk) -> None:
    keys = KeyFile(disk.root)
    keys.add("ann", 64 * "0", "operate")
    assert [row.name for row in KeyFile(disk.cut()).read()] == ["ann"]


def test_the_boot_note_of_a_program_survives_a_power_cut(disk: Disk) -> None:
    note = BootNote(disk.root / "data" / "actuator-demo.json")
    note.begin()
    note.end(Predecessor.CLEAN, 7)
    left = BootNote(disk.cut() / "data" / "actuator-demo.json")
    assert left.found() == Before(Predecessor.CLEAN, 7)


def test_a_backup_can_be_restored(disk: Disk, tmp_path: Path) -> None:
    data = tmp_path / "data"
    Store(data / "supervisor.sqlite").close()
    (data / "models" / "demo").mkdir(parents=True)
    (data / "models" / "demo" / "0001-abc.json").write_text("{}", encoding="utf-8")
    assert main(["backup", str(disk.root / "b.tar.gz"), "--data", str(data)]) == 0
    assert main(["restore", str(disk.root / "b.tar.gz"), "--data", str(disk.root / "data")]) == 0
    left = disk.cut()
    assert (left / "b.tar.gz").read_bytes() == (disk.root / "b.tar.gz").read_bytes()
    for path in (disk.root / "data").rglob("*"):
        if path.is_file():
            copy = left / path.relative_to(disk.root)
            assert copy.read_bytes() == path.read_bytes()
        assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0


def test_a_version_of_a_model_survives_a_power_cut(disk: Disk) -> None:
    nothing = Calibration()
    model = StoredModel(
        version=1,
        digest=nothing.digest,
        rig="demo",
        rig_file_digest="",
        made_at="",
        values={},
        sources={},
        uncertainties={},
        previous="",
    )
    ModelFiles(disk.root / "models" / "demo").write(model)
    assert ModelFiles(disk.cut() / "models" / "demo").read(1) == model


def test_a_downloaded_file_survives_a_power_cut(disk: Disk) -> None:
    content = b"rows"
    download = Download("a.parquet", disk.root / "out", hashlib.sha256(content).hexdigest())
    download.begin()
    download.write(content)
    download.finish()
    assert (disk.cut() / "out" / "a.parquet").read_bytes() == content


def test_the_output_of_a_command_survives_a_power_cut(disk: Disk, tmp_path: Path) -> None:
    write_output(disk.root / "jobs.csv", b"old")
    write_output(disk.root / "jobs.csv", b"new")
    assert (disk.cut() / "jobs.csv").read_bytes() == b"new"
    link = tmp_path / "link"
    link.symlink_to(disk.root / "jobs.csv")
    write_output(link, b"newest")
    assert link.is_symlink()
    assert (disk.root / "jobs.csv").read_bytes() == b"newest"
    write_output(Path(os.devnull), b"nothing")
    assert Path(os.devnull).is_char_device()


@pytest.mark.usefixtures("mask")
def test_data_and_logs_are_closed_to_other_accounts(tmp_path: Path) -> None:
    log_files.open_to_append(tmp_path / "data" / "logs" / "sensor.log").close()
    keep_from_others()
    BootNote(tmp_path / "data" / "joined" / "b" / "actuator-b.json").begin()
    Store(tmp_path / "data" / "supervisor.sqlite").close()
    (tmp_path / "data" / "jobs" / "j-1").mkdir(parents=True)
    (tmp_path / "data" / "jobs" / "j-1" / "job.mcap").write_bytes(b"")
    found = [tmp_path / "data", *(tmp_path / "data").rglob("*")]
    assert len(found) > 8
    for path in found:
        wanted = 0o700 if path.is_dir() else 0o600
        assert stat.S_IMODE(path.stat().st_mode) == wanted, path
