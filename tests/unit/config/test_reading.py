"""Rig files: merged into another one, received as JSON, and joined to the router of another rig."""

import tomllib
from pathlib import Path

import pytest

from pincette.config import ConfigError, parse_rig, parse_rig_json, read_rig

RIGS = Path(__file__).parents[3] / "deploy" / "rigs"
BASE = (RIGS / "demo.toml").read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "base.toml").write_text(BASE, encoding="utf-8")
    return tmp_path


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_rig_file_overrides_single_values_of_its_base(folder: Path) -> None:
    text = 'base = "base.toml"\n[rig]\nname = "other"\n[sensor.options]\noutput = 2\n'
    rig, demo = read_rig(written(folder, text)), read_rig(folder / "base.toml")
    assert (rig.rig.name, rig.rig.period_s) == ("other", demo.rig.period_s)
    assert rig.sensor.options == {**demo.sensor.options, "output": 2}
    assert rig.limits == demo.limits


def test_a_different_law_or_driver_inherits_no_options_from_the_base_file(folder: Path) -> None:
    text = 'base = "base.toml"\n[law]\nscheme = "dsmifc"\n[sensor]\ndriver = "other"\n'
    rig, demo = read_rig(written(folder, text)), read_rig(folder / "base.toml")
    assert demo.law.scheme == "pbsmic"
    assert rig.law == parse_rig({**tomllib.loads(BASE), "law": {"scheme": "dsmifc"}}).law
    assert (rig.sensor.options, rig.sensor.noise_um) == ({}, demo.sensor.noise_um)
    assert rig.output == demo.output


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('base = "none.toml"', "none.toml: No such file"),
        ("base = true", "base = true: expected"),
        (
            'base = "base.toml"\n[limits]\nforce_max_mN = true',
            "force_max_mN = true: must be",
        ),
        ('base = "base.toml"\n[rig]\nperiod_s = [false]', r"rig.period_s = \[false\]: must be"),
        ("base = 3", "base = 3: expected the name of a rig file"),
        ('base = "rig.toml"', "that file has a base itself"),
        ('base = "base.toml"\n[rig]\nnam = "x"', "rig.nam"),
        ('base = "base.toml"\n[bus]\nrouter = "7447"', "bus.router = '7447': .*HOST:PORT"),
        ('base = "base.toml"\n[bus]\nrouter = "bench:0"', "bus.router"),
        ('base = "base.toml"\n[bus]\nrouter = "tcp/bench:7447"', "bus.router"),
    ],
)
def test_unusable_values_are_named(folder: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_rig(written(folder, text))


@pytest.mark.parametrize("name", ["demo", "fast", "kilohertz", "bring-up", "left", "right"])
def test_a_received_rig_file_equals_the_file_that_was_read(name: str) -> None:
    rig = read_rig(RIGS / f"{name}.toml")
    loaded = parse_rig_json(rig.model_dump_json())
    assert (loaded, loaded.digest()) == (rig, rig.digest())


def test_an_invalid_received_rig_file_names_the_place() -> None:
    with pytest.raises(ConfigError, match=r"bus\.frills"):
        parse_rig_json('{"bus": {"frills": 1}}')


def test_a_rig_has_its_own_router_or_joins_one() -> None:
    left, right = (read_rig(RIGS / f"{name}.toml") for name in ("left", "right"))
    assert (left.joins, right.joins) == (False, True)
    assert left.bus.router_at == right.bus.router_at == (left.bus.host, left.bus.port)
    assert left.home(Path("data")) == Path("data")
    assert right.home(Path("data")) == Path("data/rigs/right")
    assert left.supervisor == right.supervisor
    inner = right.bus.model_copy(update={"router": "[::1]:7447"})
    assert inner.router_at == ("::1", 7447)


@pytest.mark.parametrize("table", ["grip", "grip.quick"])
def test_a_zero_of_fewer_than_ten_periods_is_refused_with_value_limit_and_remedy(
    table: str, folder: Path
) -> None:
    text = f'base = "base.toml"\n[{table}]\nzero_s = '
    assert read_rig(written(folder, f"{text}0.2")).rig.period_s == 0.02
    words = rf"{table}\.zero_s = 0\.19 s: below 0\.2 s, 10 periods of 20 ms.*or more"
    with pytest.raises(ConfigError, match=words):
        read_rig(written(folder, f"{text}0.19"))


def test_a_rig_file_without_zero_s_is_valid_for_a_long_period(folder: Path) -> None:
    tree = BASE.replace("period_s = 0.02", "period_s = 0.05")
    tree = "".join(line for line in tree.splitlines(True) if not line.startswith("zero_s"))
    rig = read_rig(written(folder, tree))
    assert rig.rig.period_s == 0.05
    assert parse_rig_json(rig.model_dump_json()) == rig
