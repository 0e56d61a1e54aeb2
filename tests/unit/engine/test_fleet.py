"""Programs and ports that a rig needs on its machine, with its own router or that of another
rig."""

import os
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from pincette.config import RigFile, read_rig
from pincette.core.topics import LOOP
from pincette.engine.fleet import Child, Fleet, ports
from pincette.engine.process import Options, run_program

RIGS = Path(__file__).parents[3] / "deploy" / "rigs"


def started(rig: RigFile, data: Path) -> list[str]:
    return Fleet(rig, Path("rig.toml"), data, lambda _name, _line: None).names()


def test_a_rig_that_joins_a_router_starts_neither_router_nor_supervisor(tmp_path: Path) -> None:
    left, right = (read_rig(RIGS / f"{name}.toml") for name in ("left", "right"))
    own = ["rig", *LOOP, "recorder"]
    assert started(left, tmp_path) == ["router", *own, "supervisor"]
    assert started(right, tmp_path) == own
    assert (tmp_path / "rigs" / "right" / "logs").is_dir()


def test_two_rigs_of_one_laboratory_share_no_port() -> None:
    left, right = (ports(read_rig(RIGS / f"{name}.toml")) for name in ("left", "right"))
    assert {"router", "supervisor"} <= set(left.values())
    assert {"router", "supervisor"}.isdisjoint(right.values())
    assert left.keys().isdisjoint(right.keys())
    assert len(right) == len(LOOP) + 2


@pytest.mark.parametrize("name", ["router", "supervisor"])
def test_programs_shared_by_a_router_are_not_started_by_a_rig_that_joins_it(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert run_program(name, RIGS / "right.toml", Options(data=tmp_path)) == 2
    assert f"start the {name} there" in caplog.text
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("left", "told"), [(0, True), (1, False)])
def test_a_program_that_cannot_log_on_a_full_disk_is_reported(
    left: int, told: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "supervisor.log"
    log.touch()
    child = Child("supervisor", cast("subprocess.Popen[str]", None), log)

    def statvfs(_: Path) -> SimpleNamespace:
        return SimpleNamespace(f_bavail=left)

    monkeypatch.setattr(os, "statvfs", statvfs)
    assert ("disk is full: free space" in child.tail()) is told
