"""Upgrade to another version: containers are replaced, stored data are kept, and a grip
succeeds."""

import hashlib
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.contained import contained
from tests.support.engine import Project, told
from tests.support.engine_rig import (
    ContainerRig,
    inspected,
    mounting,
    reached,
    short_rig,
)
from tests.support.engine_stalls import ContainerStalls
from tests.support.grips import make_ready, whole_grip
from tests.support.running import Json
from tests.support.witness import witness

NAME = "pincette-upgrade"
REVISION = "org.opencontainers.image.revision"


def version(revision: str, folder: Path) -> Project:
    """Build the images from a checkout of some revision."""
    return Project(NAME, "listen", mounting(short_rig(), folder), PINCETTE_REVISION=revision)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("upgrade")


@pytest.fixture(scope="module")
def rig(folder: Path) -> Generator[ContainerRig]:
    project = version("before", folder)
    project.down()
    try:
        project.up()
        with reached(project, short_rig(), folder) as running:
            yield running
    finally:
        project.down()


def artifacts(rig: ContainerRig, job: str) -> dict[str, str]:
    """Return the SHA-256 of each file of a job's record, as REST returns it."""
    listed: list[Json] = rig.get(f"/jobs/{job}/artifacts")["artifacts"]
    found: dict[str, str] = {}
    for one in listed:
        content = rig.client.get(f"/jobs/{job}/artifacts/{one['name']}").raise_for_status().content
        found[one["name"]] = hashlib.sha256(content).hexdigest()
        assert one["sha256"] == found[one["name"]]
    return found


def containers(rig: ContainerRig) -> dict[str, str]:
    """Return the id of each program's container."""
    names = {name: rig.containers.project.container(name) for name in contained()}
    return {name: told("inspect", "-f", "{{.Id}}", one) for name, one in names.items()}


def test_an_upgrade_keeps_stored_data(
    rig: ContainerRig,
    stalls: ContainerStalls,  # noqa: ARG001  records stalls
    folder: Path,
) -> None:
    make_ready(rig)
    with witness(rig.rig) as seen:
        job = str(whole_grip(rig, seen)["id"])
    before, kept, ran = rig.job(job), artifacts(rig, job), containers(rig)
    assert {"job.mcap", "samples.parquet", "manifest.json"} <= set(kept)

    version("after", folder).up()

    for image in ("pincette", "pincette-loop"):
        assert inspected(image)["Config"]["Labels"][REVISION] == "after"
    for name, number in containers(rig).items():
        assert number != ran[name], f"{name} is still the old container"
        one = rig.containers.project.container(name)
        assert told("inspect", "-f", f'{{{{index .Config.Labels "{REVISION}"}}}}', one) == "after"
    assert rig.job(job) == before
    assert artifacts(rig, job) == kept
    assert [one["id"] for one in rig.get("/jobs")["jobs"]].count(job) == 1
    make_ready(rig)
    with witness(rig.rig) as seen:
        later = whole_grip(rig, seen)
    assert later["id"] != job
