"""Output of the command line for alarms and checks."""

from typing import Any

import httpx
import pytest

from pincette.api.checks import Check
from pincette.api.events import Alarm
from pincette.cli import Exit
from pincette.cli.main import main
from pincette.cli.rigs import figure, mark
from pincette.cli.safety import state
from pincette.cli.watch import words
from tests.unit.client import desk

from .conftest import At

WORDS = "command_age: estimator silent for 62 ms, limit 50 ms"
AT = "2026-03-01T12:00:09.250Z"


def alarm(**values: Any) -> Alarm:
    example: dict[str, Any] = Alarm.model_json_schema()["examples"][0]
    return Alarm.model_validate({**example, **values})


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({}, "not acknowledged, until the rig is reset"),
        ({"clears": "condition"}, "not acknowledged, still present"),
        ({"cleared_at": AT}, "not acknowledged"),
        (
            {"acknowledged_at": AT, "acknowledged_by": "Ada"},
            "seen by Ada, until the rig is reset",
        ),
        ({"acknowledged_at": AT, "acknowledged_by": "Ada", "cleared_at": AT}, "seen by Ada"),
    ],
)
def test_an_alarm_states_what_clears_it(values: dict[str, Any], told: str) -> None:
    assert state(alarm(**values)) == told


@pytest.mark.parametrize(
    ("did", "by", "count", "told"),
    [
        ("raised", "", 1, f"{WORDS} (alarm 17)"),
        ("raised", "", 3, f"{WORDS}, 3 times (alarm 17)"),
        ("acknowledged", "Ada", 1, f"acknowledged by Ada: {WORDS} (alarm 17)"),
        ("cleared", "", 1, f"cleared: {WORDS} (alarm 17)"),
    ],
)
def test_an_event_is_reported_with_the_text_of_the_alarm(
    did: str, by: str, count: int, told: str
) -> None:
    about = {"id": 17, "cause": "command_age", "severity": "alarm", "count": count}
    body = {"cause": "command_age", "words": WORDS, "did": did, "by": by, "alarm": about}
    assert words("alarm", body) == told


def test_a_check_states_whether_a_job_requires_it() -> None:
    example: dict[str, Any] = Check.model_json_schema()["examples"][0]
    missing = Check.model_validate(example)
    assert "fails" in mark(missing)
    assert "look" in mark(missing.model_copy(update={"needed": False}))
    assert "ok" in mark(missing.model_copy(update={"ok": True}))


@pytest.mark.parametrize(
    ("value", "unit", "told"),
    [(None, "s", "–"), ("clear", "", "clear"), (0.2, "s", "0.2 s"), (51234.6, "MB", "51235 MB")],
)
def test_values_have_their_unit(value: float | str | None, unit: str, told: str) -> None:
    assert figure(value, unit) == told


@pytest.mark.parametrize(("given", "asked"), [("7", ["7"]), ("all", ["3", "5"])])
def test_alarms_are_acknowledged_by_their_ids_or_all(at: At, given: str, asked: list[str]) -> None:
    unseen = {"acknowledged_at": None, "acknowledged_by": None}
    alarms = [desk.example(Alarm, id=number, **unseen) for number in (3, 5)]
    alarms.append(desk.example(Alarm, id=6, acknowledged_at=AT, acknowledged_by="Ada"))
    listed = [httpx.Response(200, json={"alarms": alarms, "open": 2, "next": None})] * (
        given == "all"
    )
    seen = httpx.Response(200, json=desk.example(Alarm))
    supervisor = at(*listed, *[seen] * len(asked))
    assert main(["alarms", "--acknowledge", given]) == Exit.DONE
    acted = [path.split("/") for path in supervisor.paths() if path.endswith("/actions")]
    assert [parts[-2] for parts in acted] == asked
