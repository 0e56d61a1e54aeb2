"""Options that several commands share, and one option for each field of a job request."""

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, time, timedelta
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from typer import BadParameter, Option

from pincette.cli.readers import Form, integer
from pincette.cli.terminal import named
from pincette.core.units import unit_of
from pincette.core.validation_wording import value_text

if TYPE_CHECKING:
    from pydantic import BaseModel
    from pydantic.fields import FieldInfo


SHOWN_ITEMS = 20
"""Length of the longest list whose items are all shown."""
PREFIX = "request_"
"""Prefix of a field's name among the parameters of a command."""
NOT_OPTIONS = ("kind", "autostart", "dry_run", "rig", "labels", "queue")


ALL = "all"
"""Word that stands for all objects which a command could name."""
DATA = Path("data")
DataFolder = Annotated[
    Path, Option("--data", metavar="FOLDER", help="folder of records, logs and the journal")
]

Picture = Annotated[Path | None, Option("--plot", metavar="FILE", help="draw a PNG there")]
Everything = Annotated[bool, Option("--all", help="show every phase and figure of the result")]
Limit = Annotated[int, Option("--limit", metavar="N", parser=integer, help="at most so many")]


DAYS = {"today": 0, "yesterday": 1}
MOMENTS = "today, yesterday, 2026-03-01, 2026-03-01T14:30, or an age such as 7d or 12h"
AGO = {"d": "days", "h": "hours"}


def moment(text: str) -> str:
    """Return a time in UTC in the form for REST; a date means midnight in local time."""
    return moment_at(text, datetime.now().astimezone())


def moment_at(text: str, now: datetime) -> str:
    """Return a time in UTC, relative to the time ``now`` if so given; raises BadParameter."""
    if text in DAYS:
        day = now.date() - timedelta(days=DAYS[text])
        found = datetime.combine(day, time()).astimezone()
    elif text[-1:] in AGO and text.isascii() and text[:-1].isdecimal() and len(text) < 6:
        found = now - timedelta(**{AGO[text[-1]]: int(text[:-1])})
    else:
        try:
            found = datetime.fromisoformat(text)
        except ValueError as error:
            raise BadParameter(f"{text!r} is not a time: give {MOMENTS}") from error
        found = found if found.tzinfo else found.astimezone()
    return found.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def text_option(
    name: str, metavar: str, about: str, parser: Callable[[str], Any] | None = None
) -> Parameter:
    """Return the parameter of an option whose value is a text, optionally converted by
    ``parser``.
    """
    flag = f"--{name.replace('_', '-')}"
    option = Option(flag, metavar=metavar, help=about, parser=parser)
    return named(name, Annotated[str | None, option])


def request_parameters(request: "type[BaseModel]", without: Sequence[str] = ()) -> list[Parameter]:
    """Return parameters from which Typer creates an option for each field of a request."""
    return [
        named(PREFIX + name, _option(name, field))
        for name, field in request.model_fields.items()
        if name not in NOT_OPTIONS and name not in without
    ]


def given_fields(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a request that were given on the command line."""
    return {
        name.removeprefix(PREFIX): value
        for name, value in values.items()
        if name.startswith(PREFIX) and value is not None
    }


def stated_fields(values: Mapping[str, Any]) -> str:
    """Return the fields of a request with the values and units that are sent."""
    return ", ".join(f"{name} = {_stated(name, value)}" for name, value in values.items())


def _stated(name: str, value: Any) -> str:
    unit = unit_of(name)
    if isinstance(value, Mapping):
        return f"({stated_fields(cast('Mapping[str, Any]', value))})"
    if isinstance(value, list):
        found = [_stated(name, item) for item in cast("list[Any]", value)]
        if len(found) > SHOWN_ITEMS:
            found = [*found[:2], f"... {len(found)} entries ...", found[-1]]
        return "; ".join(found)
    if isinstance(value, float):
        return f"{value:.15g} {unit}".rstrip()
    shown = value_text(value) if value is None or isinstance(value, bool) else value
    return f"{shown} {unit}".rstrip()


def help_text(text: str) -> str:
    """Return a sentence of a docstring as a help text."""
    return (text[:1].lower() + text[1:]).replace("``", "`").rstrip(".")


def _option(name: str, field: "FieldInfo") -> Any:
    unit = unit_of(name)
    about = help_text(field.description or name.replace("_", " "))
    text = f"{about}, in {unit}" if unit else about
    form = Form(name, field.annotation)
    if bool in form.kinds:
        return _switch(name, text, default=field.default is True)
    option = Option(
        f"--{name.replace('_', '-')}",
        parser=form.read,
        metavar=form.shape,
        help=text,
        show_default=False,
        autocompletion=(lambda: list(form.choices)) if form.choices else None,
    )
    return Annotated[Any, option]


def _switch(name: str, text: str, *, default: bool) -> Any:
    word = name.replace("_", "-")
    flag = f"--no-{word}" if default else f"--{word}"
    option = Option(
        flag,
        help=f"do not {text[:1].lower()}{text[1:]}" if default else text,
        callback=_switched_off if default else None,
        show_default=False,
    )
    return Annotated[bool | None, option]


def _switched_off(value: bool | None) -> bool | None:
    return False if value else None
