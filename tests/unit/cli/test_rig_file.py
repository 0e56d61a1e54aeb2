"""Choice of the rig file, and the message if there is none."""

from pathlib import Path

import pytest

from pincette import cli
from pincette.cli import CliError, chosen, opened
from pincette.cli.main import main

ROOT = Path(__file__).parents[3]
DEMO = ROOT / "deploy/rigs/demo.toml"


def test_a_named_file_takes_precedence_over_the_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PINCETTE_RIG", "of/the/environment.toml")
    assert chosen(Path("mine.toml")) == Path("mine.toml")
    assert chosen(None) == Path("of/the/environment.toml")


def test_in_a_checkout_the_demo_rig_file_is_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PINCETTE_RIG", raising=False)
    monkeypatch.chdir(ROOT)
    assert chosen(None).resolve() == DEMO


def test_outside_a_checkout_the_alternatives_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("PINCETTE_RIG", raising=False)
    monkeypatch.chdir(tmp_path)
    assert main(["doctor", "--topics"]) == 1
    output = capsys.readouterr().err
    assert str(tmp_path) in output
    assert "--rig FILE" in output
    assert "PINCETTE_RIG" in output


@pytest.mark.parametrize(
    "url", ["socket://127.0.0.1", "socket://127.0.0.1:x", "socket://127.0.0.1:70000"]
)
def test_an_address_without_a_port_is_refused(tmp_path: Path, url: str) -> None:
    path = tmp_path / "rig.toml"
    text = DEMO.read_text(encoding="utf-8")
    path.write_text(text.replace("socket://127.0.0.1:7462", url), encoding="utf-8")
    with pytest.raises(CliError, match=r"output\.url = .*a port from 1 to 65535"):
        opened(path)


def test_the_packaged_file_is_used_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = tmp_path / "demo.toml"
    ours.write_text("", encoding="utf-8")
    monkeypatch.setattr(cli, "brought", lambda: ours)
    monkeypatch.delenv("PINCETTE_RIG", raising=False)
    monkeypatch.chdir(tmp_path)
    assert chosen(None) == ours
    monkeypatch.chdir(ROOT)
    assert chosen(None).resolve() == DEMO
