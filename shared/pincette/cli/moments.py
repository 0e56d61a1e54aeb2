"""Times as people give them on the command line."""

from datetime import UTC, datetime, time, timedelta

from typer import BadParameter

DAYS = {"today": 0, "yesterday": 1}
MOMENTS = "today, yesterday, 2026-03-01, 2026-03-01T14:30, or 7d and 12h for so long ago"
AGO = {"d": "days", "h": "hours"}


def moment(text: str) -> str:
    """A time in UTC as REST takes it; a day is that of this place, from its midnight on."""
    return moment_at(text, datetime.now().astimezone())


def moment_at(text: str, now: datetime) -> str:
    """The same, as seen from a time; raises BadParameter."""
    if text in DAYS:
        day = now.date() - timedelta(days=DAYS[text])
        found = datetime.combine(day, time()).astimezone()
    elif text[-1:] in AGO and text[:-1].isdecimal() and len(text) < 6:
        found = now - timedelta(**{AGO[text[-1]]: int(text[:-1])})
    else:
        try:
            found = datetime.fromisoformat(text)
        except ValueError as error:
            raise BadParameter(f"{text!r} is no time: give {MOMENTS}") from error
        found = found if found.tzinfo else found.astimezone()
    return found.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
