"""Both images are built without a network, from wheels that were fetched where there was one."""

import shutil
from collections.abc import Generator

import pytest

from pincette import __version__
from tests.support.checkout import ROOT
from tests.support.engine import Project, docker, told

NAME = "pincette-offline"
WHEELS = ROOT / "wheels"
IMAGES = ("pincette", "pincette-loop")
FETCH_S, BUILD_S = 300.0, 540.0


@pytest.fixture(scope="module")
def project() -> Generator[Project]:
    """With its wheels fetched as the page says, and without the images."""
    if WHEELS.exists():
        pytest.skip(f"{WHEELS.name} is there already; it is not this test's to delete")
    one = Project(NAME, "offline")
    try:
        fetched = one.shell("make wheels", FETCH_S)
        assert fetched.returncode == 0, fetched.stdout[-4000:]
        docker("image", "rm", "--force", *IMAGES)
        yield one
    finally:
        one.down()
        shutil.rmtree(WHEELS, ignore_errors=True)


def test_no_index_is_asked(project: Project) -> None:
    done = project.compose("build", "--no-cache", timeout_s=BUILD_S)
    assert done.returncode == 0, done.stdout[-4000:]
    for image in IMAGES:
        assert __version__ in told("run", "--rm", "--network", "none", image, "--version")


def test_without_the_wheels_it_cannot_be_built(project: Project) -> None:
    for wheel in WHEELS.glob("numpy-*.whl"):
        wheel.unlink()
    done = project.compose("build", "--no-cache", "loopback", timeout_s=BUILD_S)
    assert done.returncode != 0
    assert "numpy" in done.stdout
