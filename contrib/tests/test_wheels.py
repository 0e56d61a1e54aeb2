"""The wheel of each package of contrib has every file of its package, and nothing else."""

import zipfile
from pathlib import Path

import pytest

from tests.support.checkout import ROOT
from tests.support.environments import wheel

PACKAGES = sorted(path.parent for path in (ROOT / "contrib").glob("*/pyproject.toml"))


@pytest.mark.parametrize("folder", PACKAGES, ids=lambda path: path.name)
def test_a_wheel_has_every_file_of_its_package(folder: Path) -> None:
    package = folder / f"pincette_{folder.name}"
    files = (path for path in package.rglob("*") if path.is_file())
    wanted = {str(path.relative_to(folder)) for path in files if path.suffix != ".pyc"}
    with zipfile.ZipFile(wheel(f"contrib/{folder.name}")) as built:
        there = {name for name in built.namelist() if ".dist-info/" not in name}
    assert there == wanted
