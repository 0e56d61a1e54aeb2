"""``pincette run`` works with only the loop's packages, and loads nothing else anywhere."""

import subprocess
import sys
from pathlib import Path

import pytest

from pincette.__main__ import main

DEMO = Path(__file__).parents[3] / "deploy/rigs/demo.toml"
OF_PEOPLE = ("httpx", "typer", "rich", "pyarrow", "matplotlib", "sqlalchemy", "fastapi", "mcap")
WITHOUT = """\
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
from pincette.__main__ import main
sys.exit(main({words!r}))
"""
A_LOOP = f"""\
from pathlib import Path
from pincette.core import plugins
from pincette import __main__
from pincette.config import read_rig
from pincette.core.topics import LOOP
rig = read_rig(Path({str(DEMO)!r}))
services = {{name: plugins.load(plugins.SERVICES, name) for name in LOOP}}
for service in services.values():
    service.configure(rig)
plugins.load(plugins.POSITION_SENSORS, rig.sensor.driver)
plugins.load(plugins.VOLTAGE_OUTPUTS, rig.output.driver)
"""
DRAWN = ("matplotlib", "PIL", "pyarrow")


def without(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run the command without the packages that only interactive commands need."""
    script = WITHOUT.format(names=OF_PEOPLE, words=list(words))
    line = [sys.executable, "-c", script]
    return subprocess.run(line, capture_output=True, text=True, timeout=60.0, check=False)


def test_run_starts_without_packages_for_interactive_use() -> None:
    done = without("run", "--help")
    assert done.returncode == 0, done.stderr
    assert "--listen ADDRESS" in done.stdout


def test_a_missing_program_states_which_package_to_install(tmp_path: Path) -> None:
    done = without("run", "recorder", "--rig", str(DEMO), "--data", str(tmp_path))
    assert done.returncode == 2
    assert "pincette_recorder.program:run" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_unknown_command_states_what_this_image_is_for() -> None:
    done = without("doctor")
    assert done.returncode == 2
    assert "is not installed" in done.stderr
    assert "`run NAME`" in done.stderr
    assert without("--version").stdout.startswith("pincette ")


def test_with_all_packages_every_command_works(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["job", "--help"]) == 0
    assert "grip" in capsys.readouterr().out


def test_run_without_a_rig_file_ends_like_every_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("PINCETTE_RIG", raising=False)
    monkeypatch.chdir(tmp_path)
    assert main(["run", "sensor"]) == 1
    assert "no rig file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("script", "never"),
    [
        (A_LOOP, (*OF_PEOPLE, "numpy", "cryptography", "pincette.sim.bench")),
        ("import pincette_supervisor.program", DRAWN),
        (
            "from pincette.cli.main import main; main(['--help'])",
            (*DRAWN, "numpy", "sqlalchemy", "fastapi", "httpx", "rich", "pincette.config"),
        ),
        ("import pincette.cli.job", (*DRAWN, "numpy", "sqlalchemy", "fastapi")),
        (
            "from pincette.diagnostics import bus, certificates, instruments, machine, rig_file",
            (*DRAWN, "numpy", "httpx", "cryptography"),
        ),
    ],
    ids=["the loop", "the supervisor", "the help", "a command", "doctor"],
)
def test_a_command_imports_only_modules_that_it_needs_at_its_start(
    script: str, never: tuple[str, ...]
) -> None:
    case = f"import sys\n{script}\nprint('loaded:', *sorted({set(never)!r} & sys.modules.keys()))"
    line = [sys.executable, "-c", case]
    last = subprocess.check_output(line, text=True, timeout=60.0).splitlines()[-1]
    assert last.split() == ["loaded:"]


OPENED = """
from pincette.engine import instrument
from pincette.instruments.protocols import VoltageOutput, WaveOutput

class Steps(VoltageOutput):
    def __init__(self, settings): pass

class Waves(WaveOutput):
    def __init__(self, settings): pass

for driver in (Steps, Waves):
    plugins.load = lambda *_: driver
    instrument._open(services["actuator"], rig, 1.0)
    print("numpy" in sys.modules)
"""


def test_an_output_that_plays_waves_imports_sweep_code_before_the_ticks() -> None:
    line = [sys.executable, "-c", f"import sys\n{A_LOOP}{OPENED}"]
    loaded = subprocess.check_output(line, text=True, timeout=60.0).split()
    assert loaded == ["False", "True"]
