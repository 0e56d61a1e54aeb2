"""What the words of the command line make of a job's request."""

from typing import Any

import pytest

from pincette.api.request_models import Gains
from pincette.cli import job_words, readers
from pincette.cli.main import parser


def wishes(*words: str) -> dict[str, Any]:
    return job_words.wishes(parser().parse_args(["job", *words]))


def test_only_what_was_given_is_asked_for() -> None:
    assert wishes("grip") == {}
    assert wishes("grip", "--force-mN", "15", "--load-s", "1.5") == {"force_mN": 15, "load_s": 1.5}
    assert wishes("track") == {}


def test_every_shape_can_be_asked_for() -> None:
    swing = ("--shape", "triangle", "--x-pp-um", "8.45", "--frequency-hz", "0.5", "--cycles", "3")
    assert wishes("track", *swing) == {
        "shape": "triangle",
        "x_pp_um": 8.45,
        "frequency_hz": 0.5,
        "cycles": 3,
    }
    assert wishes("track", "--shape", "step", "--levels-mN", "5,10,20", "--dwell-s", "1") == {
        "shape": "step",
        "levels_mN": [5.0, 10.0, 20.0],
        "dwell_s": 1.0,
    }
    assert wishes("track", "--points", "0:5,1.5:12") == {
        "points": [{"t_s": 0.0, "force_mN": 5.0}, {"t_s": 1.5, "force_mN": 12.0}]
    }


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--points", "0:5,7"), "'7' is no point: give s:mN"),
        (("--points", "0:x"), "'x' mN cannot be used"),
        (("--levels-mN", "5,,7"), "'' mN cannot be used"),
        (("--frequency-hz", "nan"), "'nan' Hz cannot be used"),
        (("--shape", "square"), "invalid choice: 'square'"),
    ],
)
def test_what_cannot_be_read_is_said(
    words: tuple[str, ...], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        wishes("track", *words)
    assert text in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_a_law_can_be_chosen(kind: str) -> None:
    chosen = ("--scheme", "dsmifc", "--set", "printed", "--gains", "K_P=0.5,K_f=4000,delta=1e6")
    assert wishes(kind, *chosen) == {
        "scheme": "dsmifc",
        "set": "printed",
        "gains": {"K_P": 0.5, "K_f": 4000.0, "delta": 1e6},
    }
    assert wishes(kind, "--gains", "tuned") == {"gains": "tuned"}


def test_every_gain_that_a_request_knows_has_its_word() -> None:
    asked = ",".join(f"{name}=2" for name in readers.GAINS)
    assert wishes("grip", "--gains", asked)["gains"] == dict.fromkeys(readers.GAINS, 2.0)
    assert {*readers.GAINS, "force_age"} == set(Gains.model_fields)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--scheme", "pid"), "invalid choice: 'pid'"),
        (("--set", "other"), "invalid choice: 'other'"),
        (("--gains", "best"), "'best' is no gain: give tuned, or some of K_P, K_I"),
        (("--gains", "K_P=0.5,"), "'' is no gain"),
        (("--gains", "K_Q=1"), "'K_Q=1' is no gain"),
        (("--gains", "K_P=much"), "'much' cannot be used: give a finite number, such as 15"),
        (("--gains", "K_P=inf"), "'inf' cannot be used"),
    ],
)
def test_a_law_that_cannot_be_read_is_said(
    words: tuple[str, ...], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        wishes("grip", *words)
    assert text in capsys.readouterr().err
