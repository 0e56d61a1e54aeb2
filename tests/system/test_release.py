"""Wheel and sdist: complete, equal either way, and sufficient for a demo without a checkout."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.support.checkout import ROOT, await_demo_ports
from tests.support.environments import environment, python_of

BUILD = (sys.executable, "-m", "build", "--no-isolation")
BUILD_S, DEMO_S = 300.0, 170.0
PACKAGES = ("shared", *(f"services/{path.name}" for path in sorted((ROOT / "services").iterdir())))
KEPT = {"PATH", "HOME", "TMPDIR", "LANG"}


def done(command: list[str], folder: Path, seconds: float, **environment: str) -> str:
    """Return the output of a command that succeeds."""
    ended = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=seconds,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout
    return ended.stdout


def tracked() -> list[str]:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: the files of the tree are unknown")
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.check_output(command, cwd=ROOT, text=True).split("\0")
    return [name for name in names if name and (ROOT / name).is_file()]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run `make dist`: an sdist of the tree, and a wheel of that sdist."""
    folder = tmp_path_factory.mktemp("dist")
    done([*BUILD, "--outdir", str(folder), str(ROOT)], folder, BUILD_S)
    done([*BUILD, "--wheel", "--outdir", str(folder), str(ROOT / "shared")], folder, BUILD_S)
    return folder


@pytest.fixture(scope="module")
def wheel(built: Path) -> Path:
    (found,) = built.glob("pincette-*.whl")
    return found


@pytest.fixture(scope="module")
def client_wheel(built: Path) -> Path:
    (found,) = built.glob("pincette_client-*.whl")
    return found


def content(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


def test_the_wheels_contain_exactly_their_packages_and_the_example_rig_files(
    wheel: Path, client_wheel: Path
) -> None:
    wanted = {"pincette/rigs/" + path.name for path in (ROOT / "deploy/rigs").glob("*.toml")}
    for name in tracked():
        for folder in PACKAGES:
            if name.startswith(f"{folder}/pincette"):
                wanted.add(name.removeprefix(f"{folder}/"))
    assert len(wanted) > 300
    there = [
        name for one in (wheel, client_wheel) for name in content(one) if ".dist-info/" not in name
    ]
    assert sorted(there) == sorted(wanted)


def test_the_sdist_has_every_file_of_the_tree(built: Path) -> None:
    (path,) = built.glob("pincette-*.tar.gz")
    with tarfile.open(path) as file:
        there = {name.partition("/")[2] for name in file.getnames()}
    wanted = {name for name in tracked() if not name.startswith(".ci/")}
    assert wanted - there == set()
    assert there - wanted - {"PKG-INFO", ""} == set()


def test_the_tree_builds_the_same_wheel_as_the_sdist(wheel: Path, tmp_path: Path) -> None:
    done([*BUILD, "--wheel", "--outdir", str(tmp_path), str(ROOT)], tmp_path, BUILD_S)
    assert content(tmp_path / wheel.name) == content(wheel)


@pytest.mark.slow
@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_the_demo_runs_from_the_wheel(
    wheel: Path, client_wheel: Path, tmp_path: Path, version: str
) -> None:
    """The environment has the pins of requirements/run.txt and the wheels, nothing else."""
    wanted = (str(ROOT / "requirements/run.txt"), str(wheel), str(client_wheel))
    python = environment(tmp_path / "venv", *wanted, python=python_of(version))
    place = tmp_path / "elsewhere"
    place.mkdir()
    where = "import pincette; print(pincette.__file__)"
    assert done([str(python), "-c", where], place, BUILD_S).startswith(str(tmp_path / "venv"))
    await_demo_ports()
    bare = {name: os.environ[name] for name in KEPT if name in os.environ}
    ended = subprocess.run(
        [str(python.with_name("pincette")), "demo"],
        cwd=place,
        env=bare,
        capture_output=True,
        text=True,
        timeout=DEMO_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert re.search(r"^job \S+ succeeded: gripped", ended.stdout, re.MULTILINE)
    (record,) = (place / "data/jobs").glob("[!.]*")
    assert (record / "grip.png").read_bytes().startswith(b"\x89PNG")
    await_demo_ports(5.0)
