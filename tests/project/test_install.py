"""Updates of .venv: when it is rebuilt, from which sources, and which progress is printed."""

import os
import re
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
    for name in ("contrib", "dev", "run", "tools"):
        (place / f"requirements/{name}.txt").write_text("a==1\n")
    for folder in (".", "shared", "contrib/nidaqmx"):
        (place / folder).mkdir(parents=True, exist_ok=True)
        (place / folder / "pyproject.toml").write_text("[project]\n")
    return place


def test_packages_are_installed_again_after_a_change_or_move_of_the_checkout(
    install: dict[str, Any], tmp_path: Path
) -> None:
    one, other = checkout(tmp_path / "one"), checkout(tmp_path / "other")
    stamp = install["wanted_stamp"]
    before = stamp(one, "dev")
    assert before == stamp(one, "dev")
    assert before != stamp(other, "dev")
    run = stamp(one, "run")
    (one / "requirements/dev.txt").write_text("a==2\n")
    changed = stamp(one, "dev")
    assert run == stamp(one, "run")
    (one / "pyproject.toml").write_text("[project]\nname = 'b'\n")
    assert len({before, changed, stamp(one, "dev")}) == 3
    assert run != stamp(one, "run")


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
        ("Collecting a\nCollecting b\n", ", Collecting b"),
        ("Resolved 56\n\n", ", Resolved 56"),
    ],
)
def test_progress_is_read_from_the_log(
    install: dict[str, Any], tmp_path: Path, log: str, text: str
) -> None:
    path = tmp_path / "install.log"
    path.write_text(log)
    assert install["progress"](path) == text


def test_uv_searches_the_same_indexes_as_pip(
    install: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in install["OF_PIP"].values():
        monkeypatch.delenv(name, raising=False)
    listed = (
        ":env:.find-links='/own/wheels'\n"
        "global.extra-index-url='https://a.example https://b.example'\n"
        "global.find-links='/opt/wheels'\n"
        "global.timeout='60'\n"
        "install.cert='/etc/ca.crt'\n"
    )
    found = install["uv_settings"](listed)
    assert found == {
        "UV_FIND_LINKS": "/own/wheels",
        "UV_INDEX": "https://a.example https://b.example",
        "SSL_CERT_FILE": "/etc/ca.crt",
        "UV_INDEX_STRATEGY": "unsafe-best-match",
    }
    monkeypatch.setenv("UV_FIND_LINKS", "/elsewhere")
    assert "UV_FIND_LINKS" not in install["uv_settings"](listed)


def test_runtime_packages_are_installed_without_test_packages(root: Path) -> None:
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    needs = dict(re.findall(r"^([a-z-]+): (\w+) ##", makefile, re.MULTILINE))
    assert {name for name, step in needs.items() if step == "venv"} == {"demo", "up", "paper"}


def python_of(root: Path, version: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Return the Python that requirements/python.sh finds if only the given pyenv exists."""
    bare = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    return subprocess.run(
        ["sh", str(root / "requirements/python.sh"), version],
        env={**bare, "PYENV_ROOT": "/nowhere", **environment},
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )


def test_a_python_of_the_requested_version_is_found(root: Path, tmp_path: Path) -> None:
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


def test_a_python_of_another_version_is_not_used(root: Path, tmp_path: Path) -> None:
    (tmp_path / "python3.99").symlink_to(sys.executable)
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    done = python_of(root, "3.99", PATH=path, PYTHON_3_99=sys.executable)
    assert done.returncode == 1
    assert "PYTHON_3_99=" in done.stderr
