"""Parsers of the values of options and arguments."""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from typer import BadParameter

from pincette.core import numerals
from pincette.core.units import unit_of

FROM_FILE = "@"
"""First character of a value that names a file from which the value is read."""


def number(unit: str) -> Callable[[str], float]:
    """Return a parser of a finite number in a unit; an empty unit means no unit."""

    def read(text: str) -> float:
        try:
            return numerals.number(str(text))  # Typer passes default values to the parser too
        except ValueError as error:
            raise unusable(text, unit, str(error)) from error

    return read


def number_within(unit: str, least: float, most: float) -> Callable[[str], float]:
    """Return a parser of a number between two limits."""
    read_any = number(unit)

    def read(text: str) -> float:
        value = read_any(text)
        if not least <= value <= most:
            raise unusable(text, unit, f"expected {least:g} {unit} to {most:g} {unit}")
        return value

    return read


def integer(text: str) -> int:
    """Parse an integer; raises BadParameter."""
    try:
        return numerals.whole(str(text))
    except ValueError as error:
        raise BadParameter(
            f"{text!r} is not a whole number: give digits without a unit, such as 5"
        ) from error


def choice(values: Sequence[str]) -> Callable[[str], str]:
    """Return a parser of one of several words."""

    def read(text: str) -> str:
        if text not in values:
            near = get_close_matches(text, values, n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise BadParameter(f"{text!r} is not allowed: {hint}give one of {', '.join(values)}")
        return text

    return read


class Form:
    """Notation of a field's value on the command line: a text, JSON, or NAME=VALUE,..."""

    def __init__(self, name: str, annotation: Any) -> None:
        """Prepare the notation of the field ``name``; the suffix of the name is the unit."""
        self.name, self.unit = name, unit_of(name)
        self.kinds = tuple(_kinds(annotation))
        self.choices: dict[str, Any] = {
            str(value): value
            for kind in self.kinds
            if get_origin(kind) is Literal
            for value in get_args(kind)
        }
        self.models = [kind for kind in self.kinds if hasattr(kind, "model_fields")]
        self.item: Form | None = next(
            (Form(name, get_args(kind)[0]) for kind in self.kinds if get_origin(kind) is list), None
        )

    @property
    def shape(self) -> str:
        """Return the notation of the value for a help text."""
        if self.item is not None and self.item.models:
            return f"'{self.item.columns}; ...'|{FROM_FILE}FILE"
        if self.item is not None:
            one = self.item.unit or "|".join(self.item.choices) or "NUMBER"
            return f"'{one}; {one}; ...'"
        named = [f"{self.example}=..."] if self.models else []
        if self.choices or named:
            return "|".join([*self.choices, *named])
        if float in self.kinds:
            return self.unit or "NUMBER"
        return "N" if int in self.kinds else self.name.upper()

    @property
    def columns(self) -> str:
        """Return the units of the members of a record, such as ``s:mN``."""
        return ":".join(unit_of(name) for name in self.members)

    @property
    def members(self) -> dict[str, Any]:
        """Return the annotations of the members of a table, by name."""
        return {
            name: field.annotation
            for model in self.models
            for name, field in model.model_fields.items()
        }

    @property
    def is_open(self) -> bool:
        """Return True if a table accepts additional members, which are numbers."""
        return any(model.model_config.get("extra") == "allow" for model in self.models)

    @property
    def example(self) -> str:
        """Return the name of a member of a table."""
        return "NAME" if self.is_open else next(iter(self.members), "NAME")

    def read(self, text: str) -> Any:
        """Parse the text of a value; raises BadParameter."""
        if text in self.choices:
            return self.choices[text]
        if text[:1] in ("{", "[") and (self.models or self.item):
            return _from_json(self.name, text)
        if self.item is not None:
            return self._records(text) if self.item.models else self._list(text)
        if self.models:
            return self._table(text)
        if float in self.kinds:
            return number(self.unit)(text)
        if int in self.kinds:
            return integer(text)
        return choice(list(self.choices))(text) if self.choices else text

    def _list(self, text: str) -> list[Any]:
        assert self.item is not None
        try:
            parts = numerals.items(text)
        except ValueError as error:
            raise unusable(text, self.unit, str(error)) from error
        return [self.item.read(part) for part in parts]

    def _records(self, text: str) -> list[dict[str, float]]:
        """Parse records in the form ``s:mN; s:mN``, or those in the file of ``@FILE``."""
        assert self.item is not None
        names = list(self.item.members)
        if text.startswith(FROM_FILE):
            return _from_file(text.removeprefix(FROM_FILE), names)
        try:
            found = numerals.records(text, len(names))
        except ValueError as error:
            raise BadParameter(
                f"{str(error)!r} is not a point: give {self.item.columns}, such as '0:5; "
                "1.5:12; 3:5', or @FILE"
            ) from error
        return [
            {name: number(unit_of(name))(part) for name, part in zip(names, parts, strict=True)}
            for parts in found
        ]

    def _table(self, text: str) -> dict[str, Any]:
        """Parse members in the form NAME=VALUE,NAME=VALUE.

        A value may be a list: an item without a name belongs to the value before it.
        """
        parts: list[str] = []
        for part in text.split(","):
            if "=" in part or not part or not parts:
                parts.append(part)
            else:
                parts[-1] += f",{part}"
        found: dict[str, Any] = {}
        for part in parts:
            name, equals, value = part.partition("=")
            if not equals or not name or (name not in self.members and not self.is_open):
                some = f"some of {', '.join(self.members)}"
                some = "numbers by their names" if self.is_open else some
                wanted = ", or ".join([*([", ".join(self.choices)] if self.choices else []), some])
                raise BadParameter(
                    f"{part!r} cannot be used: give {wanted}, such as {self.example}=0.5"
                )
            found[name] = Form(name, self.members.get(name, float)).read(value)
        return found


def _kinds(annotation: Any) -> Iterator[Any]:
    """Yield the types of a union, without None and the metadata of ``Annotated``."""
    if get_origin(annotation) is Annotated:
        yield from _kinds(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, UnionType):
        for one in get_args(annotation):
            yield from _kinds(one)
    elif annotation is not NoneType:
        yield annotation


def _from_file(path: str, names: Sequence[str]) -> list[dict[str, float]]:
    from pincette.core.number_tables import FileError, read_table

    try:
        if not _is_parquet(path):
            return read_table(path, names)
        from pincette.records import number_file

        return number_file.parquet_rows(Path(path), names, path)
    except FileError as error:
        raise BadParameter(str(error)) from error


def _is_parquet(path: str) -> bool:
    """Return whether a file is Parquet by its name or its first bytes."""
    from pincette.records.parquet import MAGIC

    if path.lower().endswith(".parquet"):
        return True
    try:
        with Path(path).open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def literal(name: str, text: str) -> Any:
    """Parse ``NAME=TEXT``: the value is JSON if possible, otherwise a text.

    If the name ends with a unit, the value is a number, a list of numbers, or null.

    Raises
    ------
    BadParameter
        If a number is required and the text is not one, or a number in JSON is not finite.
    """
    unit = unit_of(name)
    try:
        json.loads(text)
    except ValueError:
        if not unit:
            return text
        return Form(name, list[float] if ";" in text else float).read(text)
    found = _from_json(name, text)
    if unit and isinstance(found, bool | str):
        raise unusable(text, unit, "give digits with at most one decimal sign, such as 2.5")
    return found


def _from_json(name: str, text: str) -> Any:
    """Parse JSON whose numbers are finite; raises BadParameter."""
    try:
        return json.loads(text, parse_constant=_not_finite, parse_float=_finite)
    except ValueError as error:
        raise unusable(text, unit_of(name), str(error)) from error


def _not_finite(text: str) -> float:
    raise ValueError(f"{text} is not a finite number")


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _not_finite(text)


def unusable(text: str, unit: str, why: str) -> BadParameter:
    """Return the error for a text that is not a number in a unit."""
    return BadParameter(f"{text!r}{f' {unit}' if unit else ''} cannot be used: {why}")
