"""Times on the command line: local days, and relative times."""

from datetime import datetime

import pytest
from typer import BadParameter

from pincette.cli.options import moment_at

NOW = datetime.fromisoformat("2026-03-08T15:00:00+00:00")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("12h", "2026-03-08T03:00:00.000Z"),
        ("7d", "2026-03-01T15:00:00.000Z"),
        ("2026-03-01T14:30+02:00", "2026-03-01T12:30:00.000Z"),
        ("2026-03-01T14:30Z", "2026-03-01T14:30:00.000Z"),
    ],
)
def test_a_time_is_reported_in_utc(text: str, found: str) -> None:
    assert moment_at(text, NOW) == found


def test_days_begin_at_local_midnight() -> None:
    today, yesterday = (
        datetime.fromisoformat(moment_at(text, NOW)).astimezone() for text in ("today", "yesterday")
    )
    assert (today.hour, today.minute, yesterday.hour) == (0, 0, 0)
    assert today.date().toordinal() - yesterday.date().toordinal() == 1


@pytest.mark.parametrize("text", ["soon", "d", "-1d", "9999999d", "2026-13-01", ""])
def test_an_invalid_time_is_refused_with_valid_forms(text: str) -> None:
    with pytest.raises(BadParameter, match="yesterday"):
        moment_at(text, NOW)
