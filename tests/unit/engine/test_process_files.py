"""Files of a program are not accessible to other accounts, and it may temporarily open many
files."""

import os
import stat
from collections.abc import Generator
from pathlib import Path

import pytest

from pincette.engine.process import keep_from_others


@pytest.fixture
def before() -> Generator[None]:
    mask = os.umask(0o022)
    yield
    os.umask(mask)


@pytest.mark.usefixtures("before")
@pytest.mark.parametrize(("mask", "file", "folder"), [(0o022, 0o600, 0o700), (0o277, 0o400, 0o500)])
def test_files_of_a_program_are_not_readable_by_others(
    tmp_path: Path, mask: int, file: int, folder: int
) -> None:
    os.umask(mask)
    keep_from_others()
    (tmp_path / "job").mkdir()
    (tmp_path / "job" / "job.mcap").write_bytes(b"x")
    assert stat.S_IMODE((tmp_path / "job").stat().st_mode) == folder
    assert stat.S_IMODE((tmp_path / "job" / "job.mcap").stat().st_mode) == file
