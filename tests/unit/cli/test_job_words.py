"""Requests that the command line makes for a job."""

from typing import Any

import httpx
import pytest

from pincette.api.jobs import Job
from pincette.cli import Exit
from pincette.cli.main import main
from tests.support.command_line import request_of
from tests.unit.client import desk

from .conftest import At


def fields(*words: str) -> dict[str, Any]:
    return request_of("job", *words)


def test_only_given_options_are_requested() -> None:
    assert fields("grip") == {}
    assert fields("grip", "--force-mN", "15", "--load-s", "1.5") == {"force_mN": 15, "load_s": 1.5}
    assert fields("track") == {}


def test_every_shape_can_be_requested() -> None:
    swing = ("--shape", "triangle", "--x-pp-um", "8.45", "--frequency-hz", "0.5", "--cycles", "3")
    assert fields("track", *swing) == {
        "shape": "triangle",
        "x_pp_um": 8.45,
        "frequency_hz": 0.5,
        "cycles": 3,
    }
    assert fields("track", "--shape", "step", "--levels-mN", "5; 10; 20", "--dwell-s", "1") == {
        "shape": "step",
        "levels_mN": [5.0, 10.0, 20.0],
        "dwell_s": 1.0,
    }
    assert fields("track", "--points", "0:5,1.5:12") == {
        "points": [{"t_s": 0.0, "force_mN": 5.0}, {"t_s": 1.5, "force_mN": 12.0}]
    }


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--points", "0:5,7"), "'7' is not a point: give s:mN"),
        (("--points", "0:x"), "'x' mN cannot be used"),
        (("--levels-mN", "5,,7"), "'' mN cannot be used"),
        (("--frequency-hz", "nan"), "'nan' Hz cannot be used"),
        (("--shape", "square"), "'square' is not allowed: give one of sinusoid"),
    ],
)
def test_unreadable_options_are_reported(
    words: tuple[str, ...], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["job", "track", *words]) == Exit.USAGE
    assert text in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["grip", "track"])
def test_a_law_can_be_chosen(kind: str) -> None:
    chosen = ("--scheme", "dsmifc", "--set", "printed", "--gains", "K_P=0.5,K_f=4000,delta=1e6")
    assert fields(kind, *chosen) == {
        "scheme": "dsmifc",
        "set": "printed",
        "gains": {"K_P": 0.5, "K_f": 4000.0, "delta": 1e6},
    }
    assert fields(kind, "--gains", "tuned") == {"gains": "tuned"}


def test_unknown_laws_and_gains_are_passed_to_the_supervisor() -> None:
    chosen = ("--scheme", "another", "--gains", "K_Q=1,zeta=0.7")
    assert fields("grip", *chosen) == {"scheme": "another", "gains": {"K_Q": 1.0, "zeta": 0.7}}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--set", "other"), "'other' is not allowed: give one of consistent"),
        (("--gains", "best"), "'best' cannot be used: give tuned, or numbers by their names"),
        (("--gains", "K_P=0.5,"), "'' cannot be used"),
        (("--gains", "K_Q"), "'K_Q' cannot be used"),
        (
            ("--gains", "K_P=much"),
            "'much' cannot be used: give digits with at most one decimal sign",
        ),
        (("--gains", "K_P=inf"), "'inf' cannot be used"),
    ],
)
def test_a_law_that_cannot_be_read_is_reported(
    words: tuple[str, ...], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["job", "grip", *words]) == Exit.USAGE
    assert text in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "members"),
    [
        ("pp_mN=10,frequency_hz=0.3", {"pp_mN": 10.0, "frequency_hz": 0.3}),
        ("shape=step,levels_mN=8;12,dwell_s=1", {"levels_mN": [8.0, 12.0], "dwell_s": 1.0}),
        (
            "points=0:5,1.5:12",
            {"points": [{"t_s": 0.0, "force_mN": 5.0}, {"t_s": 1.5, "force_mN": 12.0}]},
        ),
    ],
)
def test_members_of_a_path_are_named_and_may_be_lists(text: str, members: dict[str, Any]) -> None:
    assert members.items() <= fields("track", "--force", text)["force"].items()


def test_a_numeric_choice_is_sent_as_a_number() -> None:
    assert fields("calibrate", "free_response", "--arm", "2")["arm"] == 2


def test_a_shown_request_has_the_words_of_json(at: At, capsys: pytest.CaptureFixture[str]) -> None:
    request = {"kind": "grip", "until_released": True, "queue": False, "recipe": None}
    job = desk.example(Job, request=request, result=None)
    at(httpx.Response(200, json=job), httpx.Response(200, json={"artifacts": []}))
    main(["job", "show", "x"])
    words = "kind = grip, until_released = true, queue = false, recipe = null"
    assert words in capsys.readouterr().out
