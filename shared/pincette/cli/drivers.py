"""``pincette drivers``: the drivers and laws that a rig file can name."""

import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import EntryPoint
from types import ModuleType

from pydantic.fields import FieldInfo

from pincette.api.plans import InstalledLaw
from pincette.cli.terminal import Json, command, emit, group
from pincette.config import Table
from pincette.config.laws import installed_laws, law_definition
from pincette.core import plugins

TABLES = {plugins.POSITION_SENSORS: "sensor", plugins.VOLTAGE_OUTPUTS: "output"}
"""The table of the rig file that names a driver of the group."""
MET = {True: "has met its instrument", False: "has not met its instrument"}
UNSAID = "does not say whether it has met its instrument"


@dataclass(frozen=True, slots=True)
class Driver:
    """What is known of a driver."""

    name: str
    origin: str
    """Distribution and version."""
    met: bool | None = None
    """Whether it has met its instrument; None where it does not say."""
    options: tuple[str, ...] = ()
    """Each with its default, as a rig file writes it."""
    fault: str = ""
    """Why it cannot be had; empty where it can."""


app = group()


@command(app, "drivers")
def drivers(form: Json) -> None:
    """List the drivers and laws that a rig file can name, and why one cannot be used."""
    if form.json:
        found = {kind: [asdict(one) for one in installed(name)] for name, kind in TABLES.items()}
        laws = [InstalledLaw.of(law).model_dump() for law in installed_laws().values()]
        emit({**found, "laws": laws})
        return
    for name, kind in plugins.DRIVERS.items():
        print(f"{kind}s, for `driver` in [{TABLES[name]}]:")
        for driver in installed(name):
            print("\n".join(f"  {line}" for line in _lines(driver)))
    print("control laws, for `scheme` in [law]:")
    for entry in plugins.registered(plugins.LAWS):
        print("\n".join(f"  {line}" for line in _law_lines(entry)))


def _law_lines(entry: EntryPoint) -> Iterator[str]:
    yield f"{entry.name}, from {plugins.origin(entry)}"
    try:
        law = law_definition(entry.name)
    except ValueError as error:
        yield f"    cannot be used: {error}"
        return
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
    for name, thing in vars(module).items():
        own = isinstance(thing, type) and thing.__module__ == module.__name__
        if own and issubclass(thing, Table) and name.endswith("Options"):
            for option, field in thing.model_fields.items():
                yield f"{option} {_default(field)}"


def _default(field: FieldInfo) -> str:
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
