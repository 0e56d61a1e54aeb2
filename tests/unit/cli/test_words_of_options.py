"""Options are written out with their unit, words are corrected, and who waits is told."""

from time import sleep

import pytest

from pincette.cli import terminal
from pincette.cli.main import main


@pytest.mark.parametrize(
    ("given", "meant"),
    [("--force", "--force-mN"), ("--hold", "--hold-s"), ("--load=2", "--load-s")],
)
def test_an_option_without_its_unit_is_refused(
    given: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["job", "grip", given, "15"]) == 2
    told = capsys.readouterr().err
    assert "No such option" in told
    assert meant in told


@pytest.mark.parametrize(
    "words",
    [["job", "grip", "--no-wai"], ["estop", "--rig-nam", "demo"], ["run", "rig", "--dat=."]],
)
def test_an_option_cannot_be_abbreviated(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert "No such option" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["grip", "track", "calibrate"])
def test_a_kind_of_job_is_not_a_top_level_command(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([kind]) == 2
    assert f"pincette job {kind}" in capsys.readouterr().err


def test_a_rig_file_is_not_mistaken_for_the_name_of_a_rig(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["job", "list", "--rig", "rig.toml"]) == 2
    assert "No such option: --rig. Did you mean --rig-name" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["jbo"], "Did you mean 'job'?"),
        (["job", "lst"], "Did you mean 'list'?"),
        (["job", "list", "--state", "faild"], "did you mean failed?"),
        (["job", "grip", "--on-stop", "hodl"], "did you mean hold?"),
    ],
)
def test_a_mistyped_word_is_corrected(
    words: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
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
