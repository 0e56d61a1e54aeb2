"""`pincette doctor --drivers` lists the installed drivers, working or broken, and names a
missing one."""

import importlib
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pincette.cli.catalogue import Driver, installed
from pincette.cli.main import main
from pincette.cli.run import program_name
from pincette.core import plugins

Install = Callable[[str, str, str], None]
OPENER = "def open_sensor(settings, link=None): ...\n"
WHOLE = f"""\
from pydantic import Field
from pincette.config import Sensor, Table

MET = True

class WholeOptions(Table):
    head: int
    word: str = "µ"
    sizes: list[int] = Field(default_factory=list)

class Other(Table):
    unrelated: int = 1

{OPENER}"""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install a distribution that registers a position sensor from a module of its name."""
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])

    def put(distribution: str, name: str, source: str) -> None:
        module = distribution.replace("-", "_")
        (tmp_path / f"{module}.py").write_text(source, encoding="utf-8")
        about = tmp_path / f"{module}-2.1.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 2.1\n"
        )
        (about / "entry_points.txt").write_text(
            f"[{plugins.POSITION_SENSORS}]\n{name} = {module}:open_sensor\n"
        )
        # The content of the folder is cached by its modification time, which may be too coarse.
        importlib.invalidate_caches()

    return put


def found(name: str) -> Driver:
    (driver,) = [each for each in installed(plugins.POSITION_SENSORS) if each.name == name]
    return driver


def test_own_drivers_are_listed_with_options_and_defaults() -> None:
    keyence = found("keyence_lkg")
    assert keyence.origin.startswith("pincette ")
    assert keyence.met is False
    assert keyence.options == ("output = 1", 'unit = "um"', "baud = 115200")
    assert keyence.fault == ""
    outputs = {driver.name: driver for driver in installed(plugins.VOLTAGE_OUTPUTS)}
    assert "checksum = false" in outputs["icpdas_i7024"].options


def test_an_external_driver_is_listed_with_its_distribution(install: Install) -> None:
    install("drivers-whole", "whole", WHOLE)
    wanted = ("head (must be given)", 'word = "µ"', "sizes (set when it is opened)")
    assert found("whole") == Driver("whole", "drivers-whole 2.1", True, wanted)


def test_a_driver_without_a_description_is_listed(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install("drivers-bare", "bare", OPENER)
    assert found("bare") == Driver("bare", "drivers-bare 2.1", None, ())
    assert main(["doctor", "--drivers"]) == 0
    output = capsys.readouterr().out
    assert (
        "  bare, from drivers-bare 2.1\n"
        "      does not state whether it was tested with its instrument\n"
        "      options: none\n"
    ) in output


@pytest.mark.parametrize(
    ("distribution", "source", "cause"),
    [
        ("broken-import", "import none_such\n", "ModuleNotFoundError: No module named"),
        ("broken-syntax", "def\n", "SyntaxError: "),
        ("broken-value", "raise ValueError('no licence')\n", "ValueError: no licence"),
        ("broken-exit", "raise SystemExit(3)\n", "SystemExit: 3"),
        ("broken-name", "MET = True\n", "AttributeError: "),
    ],
)
def test_a_broken_driver_is_listed_and_breaks_nothing(
    install: Install,
    capsys: pytest.CaptureFixture[str],
    distribution: str,
    source: str,
    cause: str,
) -> None:
    install(distribution, "a_broken_one", source)
    assert main(["doctor", "--drivers"]) == 0
    output = capsys.readouterr().out
    assert f"  a_broken_one, from {distribution} 2.1\n      cannot be used: " in output
    assert f"cannot be imported: {cause}" in output
    for whole in ("keyence_lkg", "icpdas_i7024"):
        assert f"  {whole}, from pincette " in output


def test_an_extra_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def wanted(_name: str) -> list[str]:
        return ["pincette-sensor9==0.1.0; extra == 'sensor9'", "rich>=15"]

    monkeypatch.setattr(plugins, "requires", wanted)
    for group in (plugins.PROGRAMS, plugins.POSITION_SENSORS):
        with pytest.raises(plugins.PluginError, match=r"; pip install 'pincette\[sensor9\]'$"):
            plugins.load(group, "sensor9")
    with pytest.raises(ValueError, match=r"not installed: pip install 'pincette\[sensor9\]'$"):
        program_name("sensor9")
    assert plugins.installation("rich") == ""


def test_a_name_registered_by_two_distributions_is_refused(install: Install) -> None:
    install("one-keyence", "keyence_lkg", OPENER)
    both = [each for each in installed(plugins.POSITION_SENSORS) if each.name == "keyence_lkg"]
    assert [driver.origin.split()[0] for driver in both] == ["one-keyence", "pincette"]
    cause = "'keyence_lkg' is registered by one-keyence 2.1 and pincette .*; uninstall all but one"
    with pytest.raises(plugins.PluginError, match=cause):
        plugins.load(plugins.POSITION_SENSORS, "keyence_lkg")
    assert all("uninstall all but one" in driver.fault for driver in both)


@pytest.mark.parametrize("group", plugins.DRIVERS)
def test_an_unknown_driver_is_refused_with_the_known_ones(group: str) -> None:
    with pytest.raises(plugins.PluginError) as raised:
        plugins.load(group, "none_such")
    there = ", ".join(plugins.names(group))
    assert str(raised.value) == (
        f"no {plugins.DRIVERS[group]} 'none_such' is installed; there are {there}; "
        "`pincette doctor --drivers` lists them"
    )


def test_a_missing_plug_in_of_another_kind_is_not_reported_as_a_missing_driver() -> None:
    with pytest.raises(plugins.PluginError) as raised:
        plugins.load(plugins.PROGRAMS, "none_such")
    assert "pincette.programs 'none_such'" in str(raised.value)
    assert "pincette doctor --drivers" not in str(raised.value)
