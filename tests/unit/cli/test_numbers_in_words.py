"""Numbers on the command line are used as displayed, or refused at their option."""

import json
from pathlib import Path

import pytest

from pincette.cli import Exit
from pincette.cli.main import main
from pincette.cli.model import value, values
from pincette.cli.options import stated_fields
from pincette.records import parquet
from tests.support.command_line import request_of

REFUSED = (
    "5e",
    "1.000,5",
    "1,000",
    "1 000",
    "0x10",
    "1_000",
    "nan",
    "inf",
    "5mN",
    "１５",
    "1e400",
    "true",
    "",
)


@pytest.mark.parametrize(
    ("text", "force_mN"),
    [("2,5", 2.5), (" 5 ", 5.0), ("+5", 5.0), (".5", 0.5), ("5.", 5.0), ("007", 7.0), ("−5", -5.0)],
)
def test_a_number_is_sent_to_the_supervisor_as_it_is_displayed(text: str, force_mN: float) -> None:
    assert request_of("job", "grip", "--force-mN", text) == {"force_mN": force_mN}
    assert request_of("job", "grip", f"--force-mN={text}") == {"force_mN": force_mN}


@pytest.mark.parametrize("text", REFUSED)
@pytest.mark.parametrize("option", ["--force-mN", "--hold-s"])
def test_an_invalid_number_is_refused_at_its_option(
    option: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["job", "grip", option, text]) == Exit.USAGE
    output = capsys.readouterr().err
    assert option in output
    assert repr(text) in output


@pytest.mark.parametrize("text", ["5.0", "2,5", "1_0", "５", "1e1"])
def test_an_invalid_whole_number_is_refused_at_its_option(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["job", "track", "--cycles", text]) == Exit.USAGE
    assert repr(text) in capsys.readouterr().err
    assert main(["job", "list", "--limit", text]) == Exit.USAGE


def test_a_negative_number_is_not_mistaken_for_an_option() -> None:
    assert request_of("job", "move", "--by-um", "-5") == {"by_um": -5.0}
    assert request_of("job", "move", "--by-um", "-.5e1") == {"by_um": -5.0}


@pytest.mark.parametrize("text", ["5,10", "0,5,1,0", "5,10,20", "5;;7", "1 000"])
def test_an_ambiguous_list_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["job", "track", "--levels-mN", text]) == Exit.USAGE
    assert "--levels-mN" in capsys.readouterr().err


def test_decimal_commas_in_lists_and_points_are_read() -> None:
    assert request_of("job", "track", "--levels-mN", "0,5 1,0") == {"levels_mN": [0.5, 1.0]}
    assert request_of("job", "track", "--points", "0:5; 1,5:12") == {
        "points": [{"t_s": 0.0, "force_mN": 5.0}, {"t_s": 1.5, "force_mN": 12.0}]
    }


def test_points_are_read_from_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "path.csv"
    rows = [f"{0.02 * row:.2f};{5.0 + row % 3:.1f}".replace(".", ",") for row in range(2007)]
    file.write_text("t_s;force_mN\n" + "\n".join(rows), encoding="utf-8-sig")
    points = request_of("job", "track", "--points", f"@{file}")["points"]
    assert len(points) == 2007
    assert points[2] == {"t_s": 0.04, "force_mN": 7.0}
    file.write_text("t_s;force_mN\n0;5\n1;5,0x\n", encoding="utf-8")
    assert main(["job", "track", "--points", f"@{file}"]) == Exit.USAGE
    assert "line 3: force_mN = '5,0x'" in capsys.readouterr().err


def test_points_are_read_from_a_parquet_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, names = tmp_path / "path.parquet", ("t_s", "x_um", "force_mN")
    fields = [parquet.Field(name, "", "", "float") for name in names]
    times = [0.02 * row for row in range(4000)]
    columns: dict[str, list[float | None]] = {name: [*times] for name in names}
    parquet.write(file, fields, columns, {})
    points = request_of("job", "track", "--points", f"@{file}")["points"]
    assert points == [{"t_s": time, "force_mN": time} for time in times]
    renamed = file.rename(tmp_path / "path.pq")
    assert request_of("job", "track", "--points", f"@{renamed}")["points"] == points
    columns["force_mN"][7] = None
    parquet.write(file, fields, columns, {})
    assert main(["job", "track", "--points", f"@{file}"]) == Exit.USAGE
    assert "row 8: not numbers in t_s and force_mN" in capsys.readouterr().err
    parquet.write(file, fields[:2], {name: columns[name] for name in names[:2]}, {})
    assert main(["job", "track", "--points", f"@{file}"]) == Exit.USAGE
    assert "has the columns t_s, x_um, must have t_s and force_mN" in capsys.readouterr().err
    file.write_text("t_s", encoding="utf-8")
    assert main(["job", "track", "--points", f"@{file}"]) == Exit.USAGE
    assert "cannot be read" in capsys.readouterr().err


def test_sent_values_are_shown_with_units() -> None:
    fields = {
        "force_mN": 2.5,
        "until_released": True,
        "levels_mN": [0.5, 1.0],
        "gains": {"K_P": 0.5},
        "points": [{"t_s": float(at), "force_mN": 5.0} for at in range(30)],
    }
    reported = stated_fields(fields)
    assert "force_mN = 2.5 mN" in reported
    assert "levels_mN = 0.5 mN; 1 mN" in reported
    assert "gains = (K_P = 0.5)" in reported
    assert "30 entries" in reported


@pytest.mark.parametrize(
    ("word", "found"),
    [
        ("force_mN=8", {"force_mN": 8}),
        ("force_mN=2,5", {"force_mN": 2.5}),
        ("levels_mN=0,5; 1,0", {"levels_mN": [0.5, 1.0]}),
        ("levels_mN=[5, 10]", {"levels_mN": [5, 10]}),
        ("part.stiffness_mN_per_um=2,1", {"part": {"stiffness_mN_per_um": 2.1}}),
        ("until_released=true", {"until_released": True}),
        ("shape=step", {"shape": "step"}),
        ("hold_s=null", {"hold_s": None}),
    ],
)
def test_a_member_of_a_recipe_is_read_as_it_is_shown(word: str, found: object) -> None:
    assert values([value(word)]) == found
    assert json.loads(json.dumps(found, allow_nan=False)) == found


@pytest.mark.parametrize("text", [*REFUSED, '"5"', "NaN", "Infinity", "[1e400]"])
def test_an_invalid_number_in_a_recipe_is_refused(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["recipe", "save", "bead", f"force_mN={text}"]) == Exit.USAGE
    assert "cannot be used" in capsys.readouterr().err


@pytest.mark.parametrize("text", REFUSED[:-1])
def test_an_invalid_command_to_a_simulated_rig_is_refused(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rig", "part", "place", text]) == Exit.USAGE
    assert repr(text) in capsys.readouterr().err
