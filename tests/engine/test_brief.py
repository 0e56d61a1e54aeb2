"""Two commands of README.md complete a grip on a machine that has only Docker."""

import re
import runpy
import signal
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from packaging.utils import canonicalize_name

from tests.support.checkout import ROOT, await_text, until_interrupted
from tests.support.contained import contained
from tests.support.engine import Project, docker, told
from tests.support.engine_contents import contents
from tests.support.engine_rig import Containers, inspected, only_root
from tests.support.engine_stalls import ContainerStalls

README = (ROOT / "README.md").read_text(encoding="utf-8")
(BLOCK,) = re.findall(r"^```sh\n(docker .*?)^```$", README, re.MULTILINE | re.DOTALL)
UP_S, GRIP_S = 580.0, 60.0
BASE = "python:3.12-slim"
TOLD = ("title", "licenses", "base.name")
"""Labels of an image."""
OWN_MB = {"pincette-loop": 145, "pincette": 500}
"""Largest size of an image above its base, in MB: with a base of 205 MB the loop's image stays
below 350 MB."""
NAME = "pincette-brief"


@pytest.fixture(scope="module")
def commands() -> list[str]:
    return BLOCK.splitlines()


@pytest.fixture(scope="module")
def project(commands: list[str]) -> Generator[Project]:
    """Start the containers of the first command on a machine that has none of the images."""
    one = Project(NAME)
    one.down()
    docker("image", "rm", "--force", "pincette", "pincette-loop")
    try:
        done = one.shell(commands[0], UP_S)
        assert done.returncode == 0, f"{done.stdout[-4000:]}\n{one.said()}"
        yield one
    finally:
        one.down()


def test_the_readme_contains_two_docker_commands(commands: list[str]) -> None:
    assert commands == [
        "docker compose up -d --build --wait",
        "docker compose exec supervisor pincette job grip",
    ]


def test_the_docker_commands_of_the_readme_end_in_a_grip(
    project: Project, stalls: ContainerStalls, commands: list[str]
) -> None:
    done = project.shell(commands[1], GRIP_S)
    assert done.returncode == 0, f"{done.stdout}\n{stalls.stalls[-9:]}"
    assert re.search(r"^job \S+ succeeded: gripped\b", done.stdout, re.MULTILINE), done.stdout
    assert re.search(r"^force held +\d+\.\d+ mN ± ", done.stdout, re.MULTILINE)
    assert re.search(r"^requested force +20\.00 mN$", done.stdout, re.MULTILINE)
    kept = project.inside("recorder", "ls", "/data/jobs")
    assert re.fullmatch(r"(\d{8}-\d{6}-[0-9a-f]{6}\n)+", kept)


def test_every_container_is_confined(project: Project) -> None:
    for name in [*contained(), "loopback"]:
        status = dict(
            line.split(":\t", 1)
            for line in project.inside(name, "cat", "/proc/1/status").splitlines()
        )
        assert status["Uid"].split() == ["10001"] * 4, name
        assert int(status["CapEff"], 16) == int(status["CapBnd"], 16) == 0, name
        assert status["NoNewPrivs"] == "1", name
        limits = "{{.HostConfig.Memory}} {{.HostConfig.PidsLimit}} {{.HostConfig.ReadonlyRootfs}}"
        memory, pids, fixed = told("inspect", "--format", limits, project.container(name)).split()
        assert 0 < int(memory) <= 2**30, name
        assert 0 < int(pids) <= 256, name
        assert fixed == "true", name
        refused = project.compose("exec", "-T", name, "sh", "-c", "echo > /opt/here")
        assert "Read-only file system" in refused.stdout, name


def test_containers_publish_only_the_port_of_rest_and_only_on_loopback(project: Project) -> None:
    found = [told("port", project.container(name)) for name in [*contained(), "loopback"]]
    assert "".join(found) == "8000/tcp -> 127.0.0.1:8000"


@pytest.mark.usefixtures("project")
@pytest.mark.parametrize(("image", "pins"), [("pincette-loop", "loop"), ("pincette", "run")])
def test_an_image_contains_its_pinned_packages_and_no_build_tools(image: str, pins: str) -> None:
    found = contents(image)
    assert found.user == 10001
    assert found.tools == []
    assert found.odd == []
    assert found.writable == []
    script: dict[str, Any] = runpy.run_path(str(ROOT / "requirements/sbom.py"))
    where = script["environment"]((ROOT / "deploy/Dockerfile").read_text(encoding="utf-8"))
    text = (ROOT / f"requirements/{pins}.txt").read_text(encoding="utf-8")
    told_of = {canonicalize_name(name): version for name, version in script["pins"](text, where)}
    held = {canonicalize_name(name): version for name, version in found.packages.items()}
    for own in ("pincette", "pincette-client", "pincette-nidaqmx"):
        assert held.pop(canonicalize_name(own))
    assert held == told_of, "the output of `make sbom` differs from the packages in the image"


@pytest.mark.usefixtures("project")
def test_the_images_are_small_and_have_descriptions() -> None:
    base = inspected(BASE)["Size"]
    for image, most_MB in OWN_MB.items():
        facts = inspected(image)
        assert facts["Size"] - base < most_MB * 1e6, image
        labels = facts["Config"]["Labels"]
        named = {name: labels[f"org.opencontainers.image.{name}"] for name in TOLD}
        assert named == {"title": image, "licenses": "Apache-2.0", "base.name": BASE}
        assert labels["org.opencontainers.image.revision"]
        assert facts["Config"]["User"] == "pincette"


def test_the_small_image_names_the_image_of_the_other_commands(project: Project) -> None:
    done = project.compose("exec", "-T", "sensor", "pincette", "doctor")
    assert done.returncode == 2
    assert "The image `pincette` has all of them." in done.stdout


def test_a_program_that_hangs_is_not_healthy(project: Project) -> None:
    only_root()
    ask = ("exec", "-T", "recorder", "serves", "--to", "7447")
    assert project.compose(*ask).returncode == 0
    containers = Containers(project)
    containers.signal("recorder", signal.SIGSTOP)
    try:
        done = project.compose(*ask)
        assert done.returncode == 1
        assert "stopped or dead: pincette" in done.stdout
    finally:
        containers.signal("recorder", signal.SIGCONT)
    assert project.compose(*ask).returncode == 0


@pytest.mark.usefixtures("project")
def test_a_subscriber_outside_the_containers_receives_messages_of_the_rig(tmp_path: Path) -> None:
    Project(NAME, "listen").up()
    log = tmp_path / "subscribe.log"
    command = [str(ROOT / ".venv/bin/python"), str(ROOT / "docs/examples/subscribe.py")]
    with until_interrupted(command, tmp_path, log) as process:
        output = await_text(log, " V\n", process, 20.0)
    assert re.search(r"^ *-?\d+\.\d{3} µm +-?\d+\.\d{3} mN\n", output, re.MULTILINE)
    assert re.search(r"^ *-?\d+\.\d{4} V\n", output, re.MULTILINE)
