"""Options that several commands share, and one option for each field of a job request."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, time, timedelta
from inspect import Parameter
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, cast, get_args, get_origin

from typer import BadParameter, Option

from pincette.cli.readers import Reader, choice, integer, number, numbers, records
from pincette.cli.terminal import named
from pincette.core.units import unit_of

if TYPE_CHECKING:
    from pydantic import BaseModel
    from pydantic.fields import FieldInfo


SHOWN_ITEMS = 20
"""Length of the longest list that is shown in full."""
PREFIX = "request_"
"""Before the name of a field where it stands beside the other parameters of a command."""
NOT_OPTIONS = ("kind", "autostart", "dry_run", "rig", "labels", "queue")


DATA = Path("data")
DataFolder = Annotated[
    Path, Option("--data", metavar="FOLDER", help="folder of records, logs and the journal")
]

Picture = Annotated[Path | None, Option("--plot", metavar="FILE", help="draw a PNG there")]
Limit = Annotated[int, Option("--limit", metavar="N", parser=integer, help="at most so many")]


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
    elif text[-1:] in AGO and text.isascii() and text[:-1].isdecimal() and len(text) < 6:
        found = now - timedelta(**{AGO[text[-1]]: int(text[:-1])})
    else:
        try:
            found = datetime.fromisoformat(text)
        except ValueError as error:
            raise BadParameter(f"{text!r} is no time: give {MOMENTS}") from error
        found = found if found.tzinfo else found.astimezone()
    return found.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def request_parameters(request: "type[BaseModel]", without: Sequence[str] = ()) -> list[Parameter]:
    """Parameters of a command, from which Typer makes an option for each field of a request."""
    return [
        named(PREFIX + name, _option(name, field))
        for name, field in request.model_fields.items()
        if name not in NOT_OPTIONS and name not in without
    ]


def given_fields(values: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a request that were given on the command line."""
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
    return f"{value} {unit}".rstrip()


def help_text(text: str) -> str:
    """A sentence of a docstring as a help text."""
    return (text[:1].lower() + text[1:]).replace("``", "`").rstrip(".")


def _option(name: str, field: "FieldInfo") -> Any:
    kind, unit = _bare(field.annotation), unit_of(name)
    about = help_text(field.description or name.replace("_", " "))
    text = f"{about}, in {unit}" if unit else about
    if kind is bool:
        return _switch(name, text, default=field.default is True)
    read, shape = _reader(kind, unit)
    flag = f"--{name.replace('_', '-')}"
    completion = _values(kind)
    return Annotated[
        Any,
        Option(
            flag,
            parser=read,
            metavar=shape or name.upper(),
            help=text,
            show_default=False,
            autocompletion=(lambda: completion) if completion else None,
        ),
    ]


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


def _bare(annotation: Any) -> Any:
    """A type without the metadata of ``Annotated``, and without None."""
    if get_origin(annotation) is Annotated:
        return _bare(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        left = [_bare(one) for one in get_args(annotation) if one is not NoneType]
        return left[0] if len(left) == 1 else tuple(left)
    return annotation


def _values(kind: Any) -> list[str]:
    return [str(value) for value in get_args(kind)] if get_origin(kind) is Literal else []


def _reader(kind: Any, unit: str) -> tuple[Reader, str]:
    """What reads a value of a type, and its shape for a person."""
    if kind is float:
        return number(unit), unit or "NUMBER"
    if kind is int:
        return integer, "N"
    if values := _values(kind):
        named_by = dict(zip(values, get_args(kind), strict=True))
        read = choice(values)
        return (lambda text: named_by[read(text)]), "|".join(values)
    if get_origin(kind) is list:
        return _list_reader(_bare(get_args(kind)[0]), unit)
    if isinstance(kind, tuple):
        return _named_or_values(cast("tuple[Any, ...]", kind))
    if hasattr(kind, "model_fields"):
        return _named_or_values((kind,))
    return str, ""


def _list_reader(item: Any, unit: str) -> tuple[Reader, str]:
    from pydantic import BaseModel

    if isinstance(item, type) and issubclass(item, BaseModel):
        shape = ":".join(unit_of(name) for name in item.model_fields)
        return records(list(item.model_fields), shape), f"'{shape}; ...'|@FILE"
    one = unit or "NUMBER"
    return numbers(unit), f"'{one}; {one}; ...'"


def _with_lists(text: str) -> list[str]:
    found: list[str] = []
    for item in text.split(","):
        if "=" in item or not item or not found:
            found.append(item)
        else:
            found[-1] += f",{item}"
    return found


def _named_or_values(kinds: tuple[Any, ...]) -> tuple[Reader, str]:
    """Reader of a word, or of several members of a model as NAME=VALUE,NAME=VALUE.

    A value may be a list: what has no name goes on with the value before. Of a model that takes
    other members as well, these are numbers.
    """
    from pydantic import BaseModel

    words = [value for kind in kinds for value in _values(kind)]
    models = [one for one in kinds if isinstance(one, type) and issubclass(one, BaseModel)]
    fields = {name: field for one in models for name, field in one.model_fields.items()}
    free = any(one.model_config.get("extra") == "allow" for one in models)
    shown = "NAME" if free else next(iter(fields), "NAME")
    some = "numbers by their names" if free else f"some of {', '.join(fields)}"

    def read(text: str) -> Any:
        if text in words:
            return text
        found: dict[str, Any] = {}
        for item in _with_lists(text):
            name, equals, value = item.partition("=")
            if not equals or not name or (name not in fields and not free):
                wanted = f"{', '.join(words)}, or {some}" if words else some
                raise BadParameter(f"{item!r} cannot be used: give {wanted}, such as {shown}=0.5")
            kind = _bare(fields[name].annotation) if name in fields else float
            found[name] = _reader(kind, unit_of(name))[0](value)
        return found

    return read, "|".join([*words, f"{shown}=..."])
