"""The part of a rig file that an emergency stop reads equals the whole rig file."""

from pathlib import Path

import pytest

from pincette.config import ConfigError, read_rig
from pincette.config.stop_file import read_for_stop

DEMO = Path(__file__).parents[3] / "deploy/rigs/demo.toml"


@pytest.mark.parametrize(
    "tables",
    [
        "",
        '[rig]\nname = "left"\ncomposed = ["loop"]',
        '[rig]\ncomposed = ["estimator+controller"]',
        '[bus]\nhost = "::1"\nport = 7600\npki = "certificates"\nidentity = "ann"',
        '[bus]\nrouter = "bench:7000"',
        '[bus]\nupstream = "[fe80::1]:7000"',
        '[bus]\nupstream = "server:7000"\nserved_at = "rig"',
        '[supervisor]\nhost = "::1"\nport = 9000\ntls = true\n[bus]\npki = "/etc/pki"',
    ],
)
def test_a_stop_reads_the_same_addresses_as_every_program(tables: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(f'base = "{DEMO}"\n{tables}\n', encoding="utf-8")
    whole, part = read_rig(path), read_for_stop(path)
    assert part.notes == ()
    for name in ("host", "port", "router_at", "upstream_at", "served_by", "served_upstream"):
        assert getattr(part.bus, name) == getattr(whole.bus, name)
    assert (part.bus.pki, part.bus.identity) == (whole.bus.pki, whole.bus.identity)
    assert part.rig.name == whole.rig.name
    assert part.supervisor.url == whole.supervisor.url
    for service in ("sensor", "actuator"):
        assert part.program_of(service) == whole.program_of(service)


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("[bus]\nport = 'x'\nhost = 5\n", ["[bus] port = 'x'", "[bus] host = 5"]),
        ("[bus]\nport = 70000\n", ["[bus] port = 70000"]),
        ("[bus]\nrouter = 'bench'\n", ["[bus] router = 'bench'"]),
        ("[supervisor]\ntls = 'yes'\n", ["[supervisor] tls = 'yes'"]),
        ("bus = 5\nsupervisor = []\n", []),
        ("[bus]\nof_a_later_version = 1\n[sensor]\ndriver = 5\n", []),
    ],
)
def test_a_value_that_cannot_be_used_is_noted_and_its_default_applies(
    text: str, places: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "rig.toml"
    rig = '[rig]\nname = "left"\n'
    path.write_text(text + rig if text.startswith("bus") else rig + text, encoding="utf-8")
    found = read_for_stop(path)
    assert (found.bus.host, found.bus.port, found.bus.router) == ("127.0.0.1", 7447, None)
    assert found.supervisor.url == "http://127.0.0.1:8000"
    assert len(found.notes) == len(places)
    assert all(place in " ".join(found.notes) for place in places)


def test_a_base_that_cannot_be_read_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('base = "none.toml"\n[rig]\nname = "left"\n', encoding="utf-8")
    found = read_for_stop(path)
    assert found.rig.name == "left"
    assert len(found.notes) == 1


@pytest.mark.parametrize("text", ["", "[rig]\n", "[rig]\nname = 5\n", "[rig]\nname = 'A b'\n", "["])
def test_without_the_name_of_the_rig_a_stop_is_impossible(text: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError):
        read_for_stop(path)
