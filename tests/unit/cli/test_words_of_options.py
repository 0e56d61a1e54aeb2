"""Options are written out with their unit, misspelled words are corrected, and waiting is
reported."""

from time import sleep

import pytest

from pincette.cli import terminal
from pincette.cli.main import main


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("job grip --force 15", "--force-mN"),
        ("job grip --hold 15", "--hold-s"),
        ("job grip --load=2 15", "--load-s"),
        ("job grip --no-wai", "No such option"),
        ("estop --rig-nam demo", "No such option"),
        ("run rig --dat=.", "No such option"),
        ("job list --rig rig.toml", "--rig-name"),
        ("grip", "pincette job grip"),
        ("track", "pincette job track"),
        ("calibrate", "pincette job calibrate"),
        ("jbo", "'job'"),
        ("job lst", "'list'"),
        ("job list --state faild", "failed"),
        ("job grip --on-stop hodl", "hold"),
    ],
)
def test_an_unknown_subcommand_or_option_is_refused_and_the_right_one_is_named(
    words: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    assert meant in capsys.readouterr().err


def test_a_long_operation_is_announced(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "PATIENCE_S", 0.05)
    with terminal.patience("planning"):
        pass
    assert capsys.readouterr().err == ""
    with terminal.patience("planning"):
        sleep(0.3)
    assert capsys.readouterr().err == "planning, 0 s\n"
