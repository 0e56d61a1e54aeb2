"""When .venv is filled again, and how far it says it has come."""

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="module")
def install(root: Path) -> dict[str, Any]:
    return runpy.run_path(str(root / "requirements/install.py"))


def checkout(place: Path) -> Path:
    (place / "requirements").mkdir(parents=True)
    (place / "requirements/dev.txt").write_text("a==1\n")
    (place / "pyproject.toml").write_text("[project]\n")
    return place


def test_a_changed_or_moved_checkout_is_filled_again(
    install: dict[str, Any], tmp_path: Path
) -> None:
    one, other = checkout(tmp_path / "one"), checkout(tmp_path / "other")
    stamp = install["wanted_stamp"]
    before = stamp(one)
    assert before == stamp(one)
    assert before != stamp(other)
    (one / "requirements/dev.txt").write_text("a==2\n")
    changed = stamp(one)
    (one / "pyproject.toml").write_text("[project]\nname = 'b'\n")
    assert len({before, changed, stamp(one)}) == 3


def test_a_moved_environment_is_not_usable(install: dict[str, Any], tmp_path: Path) -> None:
    is_usable, scripts = install["is_usable"], tmp_path / install["VENV"] / "bin"
    assert not is_usable(tmp_path, this_python=False)
    scripts.mkdir(parents=True)
    (scripts / "python").symlink_to(sys.executable)
    (scripts / "pip").write_text(f"#!{scripts}/python\n")
    assert is_usable(tmp_path, this_python=True)
    (scripts / "pip").write_text("#!/elsewhere/.venv/bin/python\n")
    assert not is_usable(tmp_path, this_python=True)


@pytest.mark.parametrize(
    ("log", "text"),
    [
        ("", ""),
        ("Collecting numpy==2.4.6 (from -r a)\n", ", package 1 of about 50: numpy"),
        ("Collecting numpy==2.4.6\nInstalling collected packages: numpy\n", ", unpacking 1"),
    ],
)
def test_progress(install: dict[str, Any], tmp_path: Path, log: str, text: str) -> None:
    path = tmp_path / "install.log"
    path.write_text(log)
    shown = install["progress"](path, 50)
    assert shown.startswith(text)
    assert bool(shown) == bool(text)


def python_of(root: Path, version: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """What requirements/python.sh finds, with no pyenv but the one that is named."""
    bare = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    return subprocess.run(
        ["sh", str(root / "requirements/python.sh"), version],
        env={**bare, "PYENV_ROOT": "/nowhere", **environment},
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )


def test_a_python_of_a_version_is_found(root: Path, tmp_path: Path) -> None:
    this = "{}.{}".format(*sys.version_info)
    tools = f"{tmp_path}{os.pathsep}{Path(shutil.which('sh') or '/bin/sh').parent}"
    variable = f"PYTHON_{this.replace('.', '_')}"
    named = python_of(root, this, **{variable: sys.executable})
    assert (named.returncode, named.stdout.strip()) == (0, sys.executable)
    (tmp_path / f"python{this}").symlink_to(sys.executable)
    assert python_of(root, this, PATH=tools).returncode == 0
    kept = tmp_path / "pyenv/versions" / f"{this}.99/bin"
    kept.mkdir(parents=True)
    (kept / "python").symlink_to(sys.executable)
    (tmp_path / f"python{this}").unlink()
    assert python_of(root, this, PYENV_ROOT=str(tmp_path / "pyenv")).returncode == 0


def test_a_python_of_another_version_is_none(root: Path, tmp_path: Path) -> None:
    (tmp_path / "python3.99").symlink_to(sys.executable)
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    done = python_of(root, "3.99", PATH=path, PYTHON_3_99=sys.executable)
    assert done.returncode == 1
    assert "PYTHON_3_99=" in done.stderr
