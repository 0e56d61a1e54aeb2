"""Drivers and laws that a rig file can name, and keys of a rig, for ``pincette doctor``."""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import TYPE_CHECKING

from pincette.cli.terminal import Json, emit
from pincette.core import plugins

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

TABLES = {plugins.POSITION_SENSORS: "sensor", plugins.VOLTAGE_OUTPUTS: "output"}
"""Table of the rig file that names a driver of the group."""
MET = {True: "has met its instrument", False: "has not met its instrument"}
UNSAID = "does not say whether it has met its instrument"


@dataclass(frozen=True, slots=True)
class Driver:
    """Description of an installed driver."""

    name: str
    origin: str
    """Distribution and version that it comes from."""
    met: bool | None = None
    """Whether it has been tried with its instrument; None where it does not say."""
    options: tuple[str, ...] = ()
    """Each with its default, as a rig file writes it."""
    fault: str = ""
    """Why it cannot be used; empty where it can."""


def show_drivers(form: Json) -> None:
    """Print the drivers and laws that a rig file can name, and why one cannot be used."""
    from pincette.config.laws import described_laws

    if form.json:
        found = {kind: [asdict(one) for one in installed(name)] for name, kind in TABLES.items()}
        emit({**found, "laws": [law.model_dump() for law in described_laws()]})
        return
    for name, kind in plugins.DRIVERS.items():
        print(f"{kind}s, for `driver` in [{TABLES[name]}]:")
        for driver in installed(name):
            print("\n".join(f"  {line}" for line in _lines(driver)))
    print("control laws, for `scheme` in [law]:")
    for entry in plugins.registered(plugins.LAWS):
        print("\n".join(f"  {line}" for line in _law_lines(entry)))


def _law_lines(entry: EntryPoint) -> Iterator[str]:
    from pincette.config.laws import law_definition, laws_by_name

    yield f"{entry.name}, from {plugins.origin(entry)}"
    law = laws_by_name().get(entry.name)
    if law is None:
        try:
            law = law_definition(entry.name)
        except ValueError as error:
            yield f"    cannot be used: {error}"
            return
    if law.arms > 1:
        yield f"    of rigs with {law.arms} driven arms, which need not name it"
    yield f"    {law.title}: {law.summary}"
    gains = (f"{gain.name} = {gain.default:g} {gain.unit}".rstrip() for gain in law.parameters)
    yield f"    gains: {', '.join(gains)}"


def installed(group: str) -> list[Driver]:
    """Every driver registered in a group, by name."""
    return [_described(group, entry) for entry in plugins.registered(group)]


def _described(group: str, entry: EntryPoint) -> Driver:
    origin = plugins.origin(entry)
    try:
        plugins.load(group, entry.name)
    except plugins.PluginError as error:
        return Driver(entry.name, origin, fault=str(error))
    module = sys.modules[entry.module]
    met = vars(module).get("MET")
    options = tuple(_options(module))
    return Driver(entry.name, origin, met if isinstance(met, bool) else None, options)


def _options(module: ModuleType) -> Iterator[str]:
    """The fields of the table of options, which is a class of the module named …Options."""
    from pincette.config import Table

    for name, thing in vars(module).items():
        own = isinstance(thing, type) and thing.__module__ == module.__name__
        if own and issubclass(thing, Table) and name.endswith("Options"):
            for option, field in thing.model_fields.items():
                yield f"{option} {_default(field)}"


def _default(field: "FieldInfo") -> str:
    if field.is_required():
        return "(must be given)"
    if field.default_factory is not None:
        return "(set when it is opened)"
    return f"= {json.dumps(field.default, ensure_ascii=False, default=str)}"


def _lines(driver: Driver) -> Iterator[str]:
    yield f"{driver.name}, from {driver.origin}"
    if driver.fault:
        yield f"    cannot be used: {driver.fault}"
        return
    yield f"    {UNSAID if driver.met is None else MET[driver.met]}"
    yield f"    options: {', '.join(driver.options) or 'none'}"


def show_topics(form: Json, name: str) -> None:
    """Print what a rig publishes and which requests it answers, a key a line."""
    form.answer(topics_tree(name), lambda: _print_topics(name))


def _print_topics(name: str) -> None:
    from pincette.core.topics import REQUESTS, TOPICS, key, request_key

    print("published, a MessagePack map a sample, units in the field names:")
    _print([(key(name, one), one.message.__name__, one.summary) for one in TOPICS])
    print("\nrequested, with request and reply:")
    types = [f"{one.request.__name__} → {one.reply.__name__}" for one in REQUESTS]
    keys = [request_key(name, one) for one in REQUESTS]
    _print(list(zip(keys, types, strict=True)))


def topics_tree(name: str) -> dict[str, list[dict[str, str]]]:
    """Return topics and requests of a rig as plain data."""
    from pincette.core.topics import REQUESTS, TOPICS, key, request_key

    return {
        "published": [
            {
                "key": key(name, topic),
                "message": topic.message.__name__,
                "producer": topic.producer,
                "summary": topic.summary,
            }
            for topic in TOPICS
        ],
        "asked": [
            {
                "key": request_key(name, question),
                "request": question.request.__name__,
                "reply": question.reply.__name__,
                "summary": question.summary,
            }
            for question in REQUESTS
        ],
    }


def _print(rows: list[tuple[str, ...]]) -> None:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        print(f"  {'  '.join(cells)}".rstrip())
