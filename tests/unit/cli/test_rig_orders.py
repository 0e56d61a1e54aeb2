"""The command `pincette rig`: its arguments, its refusals, and its page."""

import tomllib
from pathlib import Path

import pytest

from pincette.bus.memory import MemoryBus
from pincette.bus.protocol import RefusalError
from pincette.cli import CliError
from pincette.cli.main import main
from pincette.cli.simulated import listing, operation_rows, read
from pincette.config import parse_rig, read_rig
from pincette.core.messages import Ack, Message, SimCommand
from pincette.core.topics import SIM_COMMAND
from pincette.engine.simulated import serve_sim_commands
from pincette.sim.bench import open_bench
from pincette.sim.script.script import Script, script_of

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs/how-to/scripted-faults.md"


@pytest.mark.parametrize(
    ("words", "order"),
    [
        ("part remove", SimCommand("part", "remove")),
        ("part place 31", SimCommand("part", "place", 31.0)),
        ("weight 5", SimCommand("weight", "hang", 5.0)),
        ("weight hang 0", SimCommand("weight", "hang", 0.0)),
        ("sensor wrong -3", SimCommand("sensor", "wrong", -3.0)),
        ("output heal", SimCommand("output", "heal")),
        ("arm hysteresis 2", SimCommand("arm", "hysteresis", 2.0)),
    ],
)
def test_arguments_of_the_command_line_are_parsed_as_a_command_to_the_simulated_rig(
    words: str, order: SimCommand
) -> None:
    assert read(words.split(), 0.0, None) == order


def test_start_and_duration_of_a_command_are_passed_on() -> None:
    assert read(["sensor", "stuck"], 2.0, 1.0) == SimCommand("sensor", "stuck", None, 2.0, 1.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("bead remove", "targets are part, weight, arm, sensor, output"),
        ("sensor", "sensor has no operation ''"),
        ("weight", "weight has no operation ''; it has hang"),
        ("weight five", "'five' is not a value"),
        ("sensor wrong nan", "'nan' is not a value"),
        ("sensor slow 9", "beyond 0..5 (s)"),
        ("part place 1 2", "TARGET WHAT VALUE at most"),
    ],
)
def test_unknown_words_are_refused_with_the_list_of_valid_ones(words: str, said: str) -> None:
    with pytest.raises(CliError) as raised:
        read(words.split(), 0.0, None)
    assert said in str(raised.value)


def test_without_arguments_all_commands_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rig", "--rig", str(ROOT / "deploy/rigs/demo.toml")]) == 0
    assert capsys.readouterr().out.rstrip("\n") == listing()
    for target, what, _, meaning in operation_rows():
        assert any(
            line.split()[:2] == [target, what] and meaning in line
            for line in listing().splitlines()
        )


def test_a_real_rig_accepts_no_simulation_commands(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / "deploy/rigs/demo.toml").read_text(encoding="utf-8")
    path = tmp_path / "rig.toml"
    path.write_text(text[: text.index("[simulation]")], encoding="utf-8")
    assert main(["rig", "part", "remove", "--rig", str(path)]) == 1
    assert "is real" in capsys.readouterr().err


def test_the_page_contains_the_whole_table() -> None:
    page = PAGE.read_text(encoding="utf-8").splitlines()
    table = [line for line in page if line.startswith("| `")]
    rows = [
        f"| `{target}` | `{what}` | {meaning} | {value or '–'} |"
        for target, what, value, meaning in operation_rows()
    ]
    assert table == [row for row in rows if not row.startswith("| `second_")]
    # Described in a sentence next to the table.
    of_second = [row.replace("`second_", "`") for row in rows if row.startswith("| `second_")]
    assert of_second == [row for row in table if row.startswith(("| `sensor`", "| `output`"))]


def test_the_examples_on_the_page_are_possible() -> None:
    blocks = PAGE.read_text(encoding="utf-8").split("```toml\n")[1:]
    found = [tomllib.loads(block.split("```")[0]) for block in blocks]
    tree = tomllib.loads((ROOT / "deploy/rigs/demo.toml").read_text(encoding="utf-8"))
    for tables in found:
        tree["simulation"] |= tables["simulation"]
    simulation = parse_rig(tree).simulation
    assert simulation is not None
    assert simulation.scripts
    assert [entry.what for entry in simulation.script] == ["garbage", "lose"]


def test_the_rig_replies_over_the_bus() -> None:
    def asked(script: Script) -> Message:
        bus = MemoryBus()
        serve_sim_commands(bus, script)
        return bus.call(SIM_COMMAND, SimCommand("sensor", "stuck"))

    with pytest.raises(RefusalError, match="scripts = true"):
        asked(Script(allowed=False))
    with pytest.raises(RefusalError, match="no rig"):
        asked(Script())
    rig = read_rig(ROOT / "deploy/rigs/bring-up.toml")
    script = script_of(rig)
    open_bench(rig, lambda: 0.0, script=script)
    assert asked(script) == Ack(0)
