"""Rig files that compose services, from the command line: certificates, doctor, started
programs."""

from pathlib import Path

import pytest

from pincette.cli import Exit, run, security
from pincette.cli.main import main
from pincette.config import RigFile, read_rig
from pincette.diagnostics import Finding
from pincette.diagnostics.certificates import certificates
from pincette.diagnostics.rig_file import composed
from pincette.engine.fleet import Fleet
from pincette.security.folder import Folder
from pincette.security.identity import OF_A_RIG
from tests.support.certificates import folder_for
from tests.support.command_line import parsed
from tests.support.partitions import composing
from tests.support.rigs import DEMO, demo_rig

RIG = read_rig(DEMO)
PAIR = "estimator+controller"


def of_rig(folder: Folder) -> set[str]:
    return {facts.identity.role for facts in folder.all() if facts.identity.rig == "demo"}


def test_up_starts_the_programs_that_the_rig_file_names(tmp_path: Path) -> None:
    def started(rig: RigFile) -> list[str]:
        return Fleet(rig, Path("rig.toml"), tmp_path, lambda _name, _line: None).names()

    around = ["recorder", "supervisor"]
    assert started(composing(RIG, "loop")) == ["router", "rig", "loop", *around]
    assert started(composing(RIG, PAIR)) == ["router", "rig", "sensor", PAIR, "actuator", *around]


@pytest.mark.parametrize("name", ["controller+estimator", PAIR])
def test_run_accepts_the_services_of_a_program_in_any_order(name: str) -> None:
    assert parsed("run", name).params["name"] == PAIR
    assert run.program_name(name) == PAIR


def test_run_lists_the_known_programs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "sensor+recorder"]) == Exit.USAGE
    output = capsys.readouterr().err
    assert "'recorder' is not a service of the loop: must be 'loop', or at least two of" in output
    with pytest.raises(SystemExit) as ended:
        run.main(["sensr"])
    assert ended.value.code == Exit.USAGE
    output = capsys.readouterr().err
    assert "did you mean sensor?" in output
    assert "router, supervisor" in output


def test_temporary_certificates_include_composed_programs(
    tmp_path: Path,
) -> None:
    security.made_certificates(RIG, tmp_path)
    folder = Folder(tmp_path / security.IN_DATA)
    assert of_rig(folder) == {*OF_A_RIG}
    for programs in (("loop",), ("loop",), (PAIR, "sensor+actuator")):
        security.made_certificates(composing(RIG, *programs), tmp_path)
        assert of_rig(folder) >= {*OF_A_RIG, *programs}
    security.made_certificates(composing(RIG, "loop"), tmp_path / "another")
    assert of_rig(Folder(tmp_path / "another" / security.IN_DATA)) == {*OF_A_RIG, "loop"}


def test_security_makes_certificates_for_composed_programs_on_demand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rig.toml"
    text = DEMO.read_text(encoding="utf-8").replace("[rig]", '[rig]\ncomposed = ["loop"]', 1)
    path.write_text(text, encoding="utf-8")
    monkeypatch.setenv("PINCETTE_RIG", str(path))
    place = tmp_path / "pki"
    assert main(["security", "init", str(place)]) == 0
    assert of_rig(Folder(place)) == {*OF_A_RIG, "loop"}
    capsys.readouterr()
    assert main(["security", "add", str(place), "demo", "--composed", "controller+estimator"]) == 0
    assert f"made: demo/{PAIR}\nrestart the router" in capsys.readouterr().out
    assert main(["security", "add", str(place), "demo", "--composed", PAIR]) == 1
    assert "not overwritten" in capsys.readouterr().err


def test_doctor_needs_the_certificates_of_the_existing_programs(tmp_path: Path) -> None:
    folder = folder_for(tmp_path / "pki", "demo")
    rig = composing(demo_rig(), "loop").secured(folder.path)
    missing = [one.what for one in certificates(rig) if one.mark == "missing"]
    assert len(missing) == 1
    assert "loop.crt: No such file" in missing[0]


def test_doctor_states_the_disadvantages_of_a_composition_and_refuses_an_impossible_one() -> None:
    def found(rig: RigFile) -> list[Finding]:
        return list(composed(rig))

    assert found(RIG) == found(composing(RIG, PAIR)) == []
    (noted,) = found(composing(RIG, "loop"))
    assert noted.mark != "missing"
    assert "the actuator is part of loop" in noted.what
    slow = RIG.sensor.model_copy(update={"options": {**RIG.sensor.options, "baud": 9600}})
    late, _ = found(composing(RIG.model_copy(update={"sensor": slow}), "sensor+actuator"))
    assert late.mark == "missing"
    assert "make the sensor a program of its own" in late.what
