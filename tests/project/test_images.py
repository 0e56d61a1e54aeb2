"""Images install the tested pins, and contain what their programs need."""

import re
import shutil
import socket
import subprocess
import sys
import tomllib
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from pincette.config import parse_rig

PROGRAMS_OF_THE_LOOP = (
    "pincette.__main__",
    "pincette.engine.program",
    "pincette.instruments.keyence_lkg",
    "pincette.instruments.icpdas_i7024",
    "pincette.instruments.srs_dc205",
    "pincette.security.folder",
    "pincette_actuator",
    "pincette_controller",
    "pincette_estimator",
    "pincette_rig.program",
    "pincette_sensor",
)
IMPORTED = """\
import importlib, sys
from importlib.metadata import packages_distributions
for name in sys.argv[1:]:
    importlib.import_module(name)
where = packages_distributions()
roots = {name.partition(".")[0] for name in sys.modules}
print(*sorted({one for root in roots for one in where.get(root, ())}))
"""
NOT_OURS = {"pincette", "pincette-client", "setuptools", "pip"}
"""Modules that are imported only in a development environment, and our own."""


@pytest.fixture(scope="module")
def dockerfile(root: Path) -> str:
    return (root / "deploy/Dockerfile").read_text(encoding="utf-8")


@cache
def pins(root: Path, name: str) -> list[Requirement]:
    """Return the pins of a file of requirements."""
    text = (root / f"requirements/{name}.txt").read_text(encoding="utf-8")
    return [Requirement(line.rstrip(" \\")) for line in text.splitlines() if "==" in line]


PLACES = [
    {
        "sys_platform": system,
        "os_name": "posix",
        "python_full_version": f"{python}.0",
        "python_version": python,
    }
    for system in ("linux", "darwin")
    for python in ("3.11", "3.12", "3.13")
]
"""Platforms of pincette, as far as the pins distinguish them."""


def held(root: Path, name: str, place: dict[str, str]) -> set[str]:
    """Return the pins that apply to a platform."""
    return {
        f"{canonicalize_name(one.name)}{one.specifier}"
        for one in pins(root, name)
        if one.marker is None or one.marker.evaluate(place)
    }


def names(root: Path, name: str) -> set[str]:
    return {canonicalize_name(one.name) for one in pins(root, name)}


@pytest.mark.parametrize(
    ("name", "tested"),
    [
        ("run", "dev"),
        ("loop", "dev"),
        ("adapters", "contrib"),
        ("build", "dev"),
        ("tools", "dev"),
        ("dev", "contrib"),
    ],
)
@pytest.mark.parametrize("place", PLACES, ids=lambda place: " ".join(place.values()))
def test_images_install_the_tested_pins(
    root: Path, name: str, tested: str, place: dict[str, str]
) -> None:
    installed = {one for one in held(root, name, place) if not one.startswith("uv==")}
    assert len(installed) > 5
    assert installed - held(root, tested, place) == set()


def test_every_package_is_installed_by_hash(dockerfile: str) -> None:
    joined = dockerfile.replace("\\\n", " ")
    installs = re.findall(r"pip(?: --python \S+)? (?:install|download|wheel) [^;&\n]*", joined)
    assert len(installs) == 11
    for line in installs:
        assert "--require-hashes" in line or "--no-index" in line, line
    assert "for one in loop run" in dockerfile
    assert re.findall(r"^FROM common AS (\S+)$", dockerfile, re.MULTILINE) == [
        "pincette-loop",
        "pincette",
        "pincette-adapters",
        "pincette-madsci",
    ]


def test_the_dockerfile_is_built_without_anything_from_elsewhere(dockerfile: str) -> None:
    assert "# syntax=" not in dockerfile
    assert "@sha256:" not in dockerfile
    bases = set(re.findall(r"^FROM (\S+)", dockerfile, re.MULTILINE))
    assert bases == {"scratch", "${PYTHON}", "tools", "build", "common"}
    assert "ARG PYTHON=python:3.12-slim\n" in dockerfile


def test_the_loop_installs_exactly_the_packages_that_its_programs_import(
    root: Path, pyproject: dict[str, Any]
) -> None:
    line = [sys.executable, "-c", IMPORTED, *PROGRAMS_OF_THE_LOOP]
    done = subprocess.run(line, capture_output=True, text=True, timeout=120.0, check=True)
    imported = {canonicalize_name(name) for name in done.stdout.split()} - NOT_OURS
    held = names(root, "loop")
    assert imported - held == set()
    # A module that another one needs may be imported when it is first used.
    assert held - imported <= {"pycparser"}
    group = {canonicalize_name(name) for name in pyproject["dependency-groups"]["loop"]}
    assert group < names(root, "run")


def test_every_image_names_its_version(dockerfile: str, pyproject: dict[str, Any]) -> None:
    assert f"image.version={pyproject['project']['version']}\n" in dockerfile
    assert f"image.licenses={pyproject['project']['license']} " in dockerfile
    assert dockerfile.count("image.revision=$REVISION") == 4
    assert dockerfile.count("USER pincette\n") == 1


def test_the_rig_file_of_the_images_matches_compose(root: Path, dockerfile: str) -> None:
    text = (root / "deploy/rigs/demo.toml").read_text(encoding="utf-8")
    assert re.search(r'^\[supervisor\]\nhost = "127\.0\.0\.1"\nport = 8000$', text, re.MULTILINE)
    (change,) = re.findall(r"sed -i '([^']+)'", dockerfile)
    command = ["sed", change]
    made = subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
    (added,) = re.findall(r"printf '(\\n\[%s\][^']+)' \$one", dockerfile)
    for one in ("sila", "foxglove"):
        made += added.replace("\\n", "\n").replace("%s", one)
    rig = parse_rig(tomllib.loads(made))
    for server in (rig.supervisor, rig.sila, rig.foxglove):
        assert (server.host, server.behind) == ("0.0.0.0", "container")
    assert parse_rig(tomllib.loads(text)).supervisor.behind == "nothing"
    compose = (root / "docker-compose.yml").read_text(encoding="utf-8")
    assert '"127.0.0.1:8000:8000"' in compose


def serves(root: Path, proc: Path, *asked: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [root / "deploy/serves", *asked],
        env={"PATH": "/usr/bin:/bin", "PROC": str(proc)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """Return the view of a container: its network and one sleeping process."""
    (tmp_path / "1").mkdir()
    (tmp_path / "net").symlink_to("/proc/self/net", target_is_directory=True)
    (tmp_path / "1/status").write_text("Name:\tpincette\nState:\tS (sleeping)\n")
    return tmp_path


def opened(place: Path) -> Path:
    """Return the same with the files and sockets that this process has open now."""
    folder = place / "1/fd"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for one in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # the descriptor of the listing itself is closed already
            (folder / one.name).symlink_to(one.readlink())
    return place


def test_the_health_check_tests_the_listening_port_and_the_link_to_the_router(
    root: Path, own: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        assert serves(root, opened(own), port).returncode == 0
        assert serves(root, own, "--to", port).returncode == 1
        with socket.create_connection(("127.0.0.1", int(port))):
            assert serves(root, opened(own), port, "--to", port).returncode == 0
    done = serves(root, opened(own), port)
    assert (done.returncode, done.stderr) == (1, f"does not listen on port {port}\n")


def test_the_health_check_ignores_listening_ports_of_other_programs(root: Path, own: Path) -> None:
    opened(own)
    with socket.create_server(("127.0.0.1", 0)) as server:
        assert serves(root, own, str(server.getsockname()[1])).returncode == 1


@pytest.mark.parametrize("state", ["T (stopped)", "Z (zombie)"])
def test_a_program_that_is_stopped_or_dead_does_not_serve(
    root: Path, own: Path, state: str
) -> None:
    assert serves(root, own).returncode == 0
    (own / "1/status").write_text(f"Name:\tpincette\nState:\t{state}\n")
    done = serves(root, own)
    assert (done.returncode, done.stderr) == (1, "stopped or dead: pincette\n")
