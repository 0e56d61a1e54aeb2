"""Findings of doctor about the real-time priority that the loop requests."""

import os
import sys
from pathlib import Path

import pytest

from pincette.config import RigFile, read_rig
from pincette.config.programs import RealTime
from pincette.diagnostics.machine import machine, os_requests, priority

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="settings are requested on Linux only"
)


def refuse(*_wish: object) -> None:
    raise PermissionError


def take(*_wish: object) -> None:
    """Accept the priority, as a system does that permits it."""


def test_a_permitted_fixed_priority_passes_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", take)
    finding = priority()
    assert finding.mark == "ok"
    assert finding.what == "priority: fixed priority (SCHED_FIFO 10) permitted: yes"


@pytest.mark.parametrize(
    ("niceness", "instead"), [(take, "niceness -10"), (refuse, "normal priority")]
)
def test_an_unsuitable_machine_is_noted_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, niceness: object, instead: str
) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", niceness)
    finding = priority()
    assert finding.mark == "note"
    assert f"permitted: no; the loop gets {instead}" in finding.what
    assert "LimitRTPRIO=10" in finding.remedy


def test_checking_permissions_changes_nothing_of_the_program(tmp_path: Path) -> None:
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)
    found = [finding.what for finding in machine(tmp_path)]
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0)) == before
    assert len([what for what in found if what.startswith("priority: ")]) == 1


def asking(realtime: RealTime, time: str = "real") -> RigFile:
    rig = read_rig(Path("deploy/rigs/demo.toml"))
    changed = rig.rig.model_copy(update={"time": time})
    return rig.model_copy(update={"realtime": realtime, "rig": changed})


def test_settings_that_are_not_permitted_are_noted_or_required() -> None:
    before = os.sched_getaffinity(0)
    (noted,) = os_requests(asking(RealTime(cores={"sensor": (1023,)})))
    assert noted.mark == "note"
    assert noted.what.startswith("[realtime] sensor runs without processors 1023 of its own")
    assert "--cpuset-cpus" in noted.remedy
    every = list(os_requests(asking(RealTime(cores=(1023,), required=("cores",)))))
    assert [one.mark for one in every] == ["missing"] * 4
    assert os.sched_getaffinity(0) == before


def test_in_lockstep_no_scheduling_is_requested_from_the_system() -> None:
    assert list(os_requests(asking(RealTime(cores=(1023,)), "lockstep"))) == []


def test_the_document_named_in_remedies_exists() -> None:
    page = Path(__file__).parents[3] / "docs/how-to/real-time.md"
    assert "LimitRTPRIO=10" in page.read_text(encoding="utf-8")
