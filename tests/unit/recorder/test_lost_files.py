"""Records whose folder or files are removed or replaced, during a job or after it."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pincette.core.messages import Ack, Recorded
from pincette.records import folder as files
from tests.support.recorded import EPOCH, loop
from tests.unit.recorder.conftest import Bench
from tests.unit.recorder.test_power_cut import restart


def _unlink(folder: Path) -> None:
    (folder / files.LIVE).unlink()


def _copy(folder: Path) -> None:
    """Replace the file by a copy, as tools do that compress or synchronise folders."""
    content = (folder / files.LIVE).read_bytes()
    (folder / files.LIVE).unlink()
    (folder / files.LIVE).write_bytes(content)


def _remove(folder: Path) -> None:
    shutil.rmtree(folder)


def _make_again(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


def _move_all(folder: Path) -> None:
    folder.parent.rename(folder.parent.with_name("elsewhere"))


def _block_manifest(folder: Path) -> None:
    (folder / files.MANIFEST).mkdir()


@pytest.mark.parametrize("hurt", [_unlink, _copy, _remove, _make_again, _move_all, _block_manifest])
def test_a_record_missing_from_its_folder_at_its_end_is_not_complete(
    bench: Bench, hurt: Callable[[Path], None]
) -> None:
    folder = bench.jobs / "j-1"
    assert bench.begin() == Ack(0)
    bench.feed(loop(30)[:90])
    bench.wait(0.3)
    hurt(folder)
    bench.feed(loop(30)[90:])
    recorded = bench.finish(29)
    assert isinstance(recorded, Recorded)
    assert not recorded.complete
    assert str(folder) in recorded.detail
    assert files.read_manifest(folder).get("complete") is not True
    assert bench.begin("j-2", EPOCH + 1) == Ack(0)


def test_a_start_of_the_recorder_notices_lost_messages_of_a_record(bench: Bench) -> None:
    bench.begin()
    bench.feed(loop(30))
    bench.finish(29)
    folder = bench.jobs / "j-1"
    _unlink(folder)
    table = (folder / files.SAMPLES).read_bytes()
    for _ in range(2):
        assert restart(bench.jobs).damaged == {"j-1": [files.LIVE]}
    assert files.read_manifest(folder)["complete"] is False
    assert (folder / files.SAMPLES).read_bytes() == table


def test_a_folder_without_a_record_is_accepted(bench: Bench) -> None:
    """The supervisor writes such a folder if there was no recorder."""
    folder = bench.jobs / "j-1"
    folder.mkdir(parents=True)
    files.write_json(folder / files.RESULT, {"outcome": "gripped"})
    files.write_manifest(folder, {"complete": False, "detail": "no recorder"})
    assert restart(bench.jobs).damaged == {}
