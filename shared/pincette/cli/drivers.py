"""`pincette drivers`: the position sensors and voltage outputs that a rig file can name."""

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from types import ModuleType

from pydantic.fields import FieldInfo

from pincette import plugins
from pincette.config import Table

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


def drivers() -> int:
    """List the drivers; one that is broken is listed with the reason."""
    for group, kind in plugins.DRIVERS.items():
        print(f"{kind}s, for `driver` in [{TABLES[group]}]:")
        for driver in installed(group):
            print("\n".join(f"  {line}" for line in _lines(driver)))
    return 0


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
