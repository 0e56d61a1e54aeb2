"""Lists for ``pincette doctor``: drivers and laws for rig files, and the keys of a rig."""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import TYPE_CHECKING

from pincette.cli.terminal import Json, emit, screen, table
from pincette.core import plugins

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo
    from rich.console import Console

    from pincette.config import Table

TABLES = {plugins.POSITION_SENSORS: "sensor", plugins.VOLTAGE_OUTPUTS: "output"}
"""Tables of the rig file that name drivers, by entry-point group."""
MET = {True: "was tested with its instrument", False: "has not been tested with its instrument"}
UNSAID = "does not state whether it was tested with its instrument"


@dataclass(frozen=True, slots=True)
class Driver:
    """Description of an installed driver."""

    name: str
    origin: str
    """Distribution that contains the driver, with version."""
    met: bool | None = None
    """True if the driver has been tested with its instrument; None if the driver does not state
    this.
    """
    options: tuple[str, ...] = ()
    """Options, each with its default, in the form of a rig file."""
    fault: str = ""
    """Reason why the driver cannot be used; empty if it can."""


def show_drivers(form: Json) -> None:
    """Print the drivers and laws that a rig file can name, and the errors of those that cannot be
    used.
    """
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
        yield f"    for rigs with {law.arms} driven arms; used without being named"
    yield f"    {law.title}: {law.summary}"
    gains = (f"{gain.name} = {gain.default:g} {gain.unit}".rstrip() for gain in law.parameters)
    yield f"    gains: {', '.join(gains)}"


def installed(group: str) -> list[Driver]:
    """Return every driver registered in a group, by name."""
    return [_described(group, entry) for entry in plugins.registered(group)]


def _described(group: str, entry: EntryPoint) -> Driver:
    origin = plugins.origin(entry)
    try:
        plugins.load(group, entry.name)
    except plugins.PluginError as error:
        return Driver(entry.name, origin, fault=str(error))
    module = sys.modules[entry.module]
    met = vars(module).get("MET")
    options = tuple(f"{name} {_default(field)}" for _, name, field in options_of(module))
    return Driver(entry.name, origin, met if isinstance(met, bool) else None, options)


def options_of(module: ModuleType) -> "Iterator[tuple[type[Table], str, FieldInfo]]":
    """Yield the options of a driver, with their table. They are defined by the class …Options in
    its module.
    """
    from pincette.config import Table

    for name, thing in vars(module).items():
        own = isinstance(thing, type) and thing.__module__ == module.__name__
        if own and issubclass(thing, Table) and name.endswith("Options"):
            for option, field in thing.model_fields.items():
                yield thing, option, field


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
    """Print the keys on which a rig publishes and replies, one per line."""
    topics = topics_tree(name)
    form.answer(topics, lambda: _print_topics(topics, screen()))


def _print_topics(topics: dict[str, list[dict[str, str]]], console: "Console") -> None:
    console.print("published, one MessagePack map per sample, units in the field names:")
    rows = [(one["key"], one["message"], one["summary"]) for one in topics["published"]]
    console.print(table("key", "message", "meaning", rows=rows, right=()))
    console.print("\nrequested:")
    rows = [(one["key"], one["request"], one["reply"]) for one in topics["asked"]]
    console.print(table("key", "request", "reply", rows=rows, right=()))


def topics_tree(name: str) -> dict[str, list[dict[str, str]]]:
    """Return topics and requests of a rig as dictionaries and lists."""
    from pincette.core.topics import INPUTS, REQUESTS, TOPICS, key, request_key

    return {
        "published": [
            {
                "key": key(name, topic),
                "message": topic.message.__name__,
                "producer": topic.producer,
                "summary": topic.summary,
            }
            for topic in (*TOPICS, *INPUTS)
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
