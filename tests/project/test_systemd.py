"""The systemd units start every program of a rig with existing commands."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from pincette.engine.fleet import Fleet
from tests.support.command_line import parsed
from tests.support.rigs import demo_rig

UNIT = "pincette@.service"
HARDENED = {
    "User": "pincette",
    "NoNewPrivileges": "yes",
    "ProtectSystem": "strict",
    "CapabilityBoundingSet": "",
    "DevicePolicy": "closed",
    "SupplementaryGroups": "dialout",
    "LimitRTPRIO": "10",
    "LimitMEMLOCK": "infinity",
    "StateDirectoryMode": "0700",
    "UMask": "0077",
    "Restart": "on-failure",
    "RestartPreventExitStatus": "2",
}
TRY_S = 60.0


@pytest.fixture(scope="module")
def units(root: Path) -> Path:
    return root / "deploy" / "systemd"


def settings(path: Path) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        name, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(name, []).append(value)
    return found


def wanted(path: Path) -> set[str]:
    return set(re.findall(r"pincette@([a-z]+)\.service", " ".join(settings(path)["Wants"])))


def test_each_target_starts_the_programs_that_up_starts_on_its_host(
    units: Path, tmp_path: Path
) -> None:
    rig = demo_rig({"bus": {"upstream": "10.0.0.1:7447"}})
    edge, server = (
        set(Fleet(rig, tmp_path, tmp_path, lambda _name, _line: None, server=server).names())
        for server in (False, True)
    )
    assert wanted(units / "pincette-edge.target") == edge - {"rig"}  # the rig is simulated
    assert wanted(units / "pincette-server.target") == server


def test_each_unit_runs_an_existing_command(units: Path) -> None:
    (line,) = settings(units / UNIT)["ExecStart"]
    for target in ("pincette-edge.target", "pincette-server.target"):
        for name in wanted(units / target):
            program, *words = shlex.split(line.replace("%i", name))
            assert Path(program).name == "pincette"
            assert parsed(*words).params["name"] == name


def test_a_program_has_no_more_rights_than_it_needs(units: Path) -> None:
    found = settings(units / UNIT)
    assert {name: found[name][-1] for name in HARDENED} == HARDENED


def test_systemd_understands_the_units(units: Path, tmp_path: Path) -> None:
    tool = shutil.which("systemd-analyze")
    if tool is None:
        pytest.skip("systemd-analyze is not installed")
    for path in units.iterdir():
        text = path.read_text(encoding="utf-8").replace("/opt/pincette/bin/pincette", "/bin/true")
        (tmp_path / path.name).write_text(text, encoding="utf-8")
    (tmp_path / UNIT).rename(tmp_path / "pincette@sensor.service")
    places = [str(path) for path in sorted(tmp_path.glob("pincette*"))]
    completed = subprocess.run(
        [tool, "verify", "--man=no", *places],
        capture_output=True,
        text=True,
        timeout=TRY_S,
        check=False,
    )
    assert [line for line in completed.stderr.splitlines() if "pincette" in line] == []
