"""Readers of values, and the options of a job: one for each field of its request."""

import math
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, time, timedelta
from difflib import get_close_matches
from inspect import Parameter
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, cast, get_args, get_origin

from typer import BadParameter, Option

from pincette.cli.terminal import named

if TYPE_CHECKING:
    from pydantic import BaseModel
    from pydantic.fields import FieldInfo


UNITS = {
    "_um_per_s": "µm/s",
    "_um_per_s2": "µm/s²",
    "_V_per_s": "V/s",
    "_mN": "mN",
    "_um": "µm",
    "_hz": "Hz",
    "_V": "V",
    "_s": "s",
}
PREFIX = "request_"
"""Before the name of a field where it stands beside the other parameters of a command."""
NOT_OPTIONS = ("kind", "autostart", "dry_run", "rig", "labels", "queue")
Reader = Callable[[str], Any]


def number(unit: str) -> Callable[[str], float]:
    """Reader of a finite number of a unit, or of none."""
    value_of, number_of = (f" {unit}", f" of {unit}") if unit else ("", "")

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise BadParameter(
                f"{text!r}{value_of} cannot be used: give a finite number{number_of}, such as 15"
            )
        return value

    return read


def integer(text: str) -> int:
    """A whole number."""
    try:
        return int(text)
    except ValueError as error:
        raise BadParameter(
            f"{text!r} is no whole number: give one without a unit, such as 5"
        ) from error


def choice(values: Sequence[str]) -> Callable[[str], str]:
    """Reader of one of several words."""

    def read(text: str) -> str:
        if text not in values:
            near = get_close_matches(text, values, n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise BadParameter(f"{text!r} is no choice: {hint}give one of {', '.join(values)}")
        return text

    return read


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
    elif text[-1:] in AGO and text[:-1].isdecimal() and len(text) < 6:
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


def help_text(text: str) -> str:
    """A sentence of a docstring as a help text."""
    return (text[:1].lower() + text[1:]).replace("``", "`").rstrip(".")


def unit_of(name: str) -> str:
    """Unit of a field, from the end of its name; empty if it has none."""
    return next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")


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
        fields = [(name, unit_of(name)) for name in item.model_fields]
        shape = ":".join(unit for _, unit in fields)
        return _tuples(fields, shape), f"{shape},..."
    return _list_of(number(unit)), f"{unit or 'NUMBER'},{unit or 'NUMBER'},..."


def _list_of(read: Callable[[str], float]) -> Callable[[str], list[float]]:
    return lambda text: [read(item) for item in text.split(",")]


def _tuples(fields: Sequence[tuple[str, str]], shape: str) -> Reader:
    """Reader of several records, as s:mN,s:mN."""

    def read(text: str) -> list[dict[str, float]]:
        found: list[dict[str, float]] = []
        for item in text.split(","):
            parts = item.split(":")
            if len(parts) != len(fields):
                raise BadParameter(f"{item!r} is no point: give {shape}, such as 0:5,1.5:12,3:5")
            pairs = zip(fields, parts, strict=True)
            found.append({name: number(unit)(part) for (name, unit), part in pairs})
        return found

    return read


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
