"""All images are built without a network, from wheels that were downloaded before."""

import shutil
from collections.abc import Generator

import pytest

from contrib.support.stock_clients import grip_by_sila
from pincette import __version__
from tests.support.checkout import ROOT
from tests.support.contained import PROFILES
from tests.support.engine import Project, docker, told
from tests.support.engine_rig import adapted_rig, mounting

NAME = "pincette-offline"
WHEELS = ROOT / "wheels"
IMAGES = ("pincette", "pincette-loop", "pincette-adapters", "pincette-madsci")
FETCH_S, BUILD_S = 600.0, 900.0


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Generator[Project]:
    """The wheels are downloaded as the page describes, and the images are deleted."""
    if WHEELS.exists():
        pytest.skip(f"{WHEELS.name} exists already; this test must not delete it")
    over = mounting(adapted_rig(), tmp_path_factory.mktemp("offline"), "sila", "foxglove")
    one = Project(NAME, "offline", over, COMPOSE_PROFILES=",".join(PROFILES))
    try:
        fetched = one.shell("make wheels", FETCH_S)
        assert fetched.returncode == 0, fetched.stdout[-4000:]
        docker("image", "rm", "--force", *IMAGES)
        yield one
    finally:
        one.down()
        shutil.rmtree(WHEELS, ignore_errors=True)


def test_without_a_package_index_the_rig_grips(project: Project) -> None:
    done = project.compose("build", "--no-cache", timeout_s=BUILD_S)
    assert done.returncode == 0, done.stdout[-4000:]
    for image in IMAGES[:3]:
        assert __version__ in told("run", "--rm", "--network", "none", image, "--version")
    project.up()
    grip_by_sila()


def test_without_the_wheels_the_image_cannot_be_built(project: Project) -> None:
    for wheel in WHEELS.glob("numpy-*.whl"):
        wheel.unlink()
    done = project.compose("build", "--no-cache", "loopback", timeout_s=BUILD_S)
    assert done.returncode != 0
    assert "numpy" in done.stdout
