"""Services, programs and drivers registered as entry points, imported when needed."""

import sys
from functools import cache
from importlib.metadata import (
    EntryPoint,
    EntryPoints,
    PackageNotFoundError,
    entry_points,
    requires,
)
from pkgutil import resolve_name
from typing import Any, TypeVar, cast

SERVICES = "pincette.services"
PROGRAMS = "pincette.programs"
KEYS = "pincette.keys"
LAWS = "pincette.laws"
POSITION_SENSORS = "pincette.position_sensors"
VOLTAGE_OUTPUTS = "pincette.voltage_outputs"
JOB_KINDS = "pincette.job_kinds"
CALIBRATIONS = "pincette.calibrations"
SIMULATED_INSTRUMENTS = "pincette.simulated_instruments"
COMMANDS = "pincette.commands"

DRIVERS = {POSITION_SENSORS: "position sensor", VOLTAGE_OUTPUTS: "voltage output"}
"""Entry-point groups from which a rig file chooses a driver, each with the word for one of its
members."""
CALLED = {**DRIVERS, LAWS: "control law", JOB_KINDS: "kind of job", CALIBRATIONS: "calibration"}


T = TypeVar("T")


class PluginError(Exception):
    """Error for a plug-in that does not exist or cannot be imported.

    The text lists the existing ones, or the error.
    """


@cache
def _all_entries(_path: tuple[str, ...]) -> EntryPoints:
    # The call reads the metadata of every installed distribution, which takes 10 ms or more. The
    # class that Python 3.11 returns also has the method ``select``.
    return cast(EntryPoints, entry_points())


@cache
def _installed(group: str, path: tuple[str, ...]) -> EntryPoints:
    return _all_entries(path).select(group=group)


def _entries(group: str) -> EntryPoints:
    return _installed(group, tuple(sys.path))


def registered(group: str) -> list[EntryPoint]:
    """Return everything registered in a group, by name and package, without importing it."""
    return sorted(_entries(group), key=lambda entry: (entry.name, origin(entry)))


def names(group: str) -> list[str]:
    """Return the names registered in a group."""
    return sorted({entry.name for entry in _entries(group)})


def origin(entry: EntryPoint) -> str:
    """Return the distribution that registers an entry, and its version."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "an unknown distribution"


def resolve(reference: str, of: type[T], what: str) -> T:
    """Import ``module:attribute`` that a plug-in names; raises PluginError."""
    try:
        found = resolve_name(reference)
    # A module from another package may fail in any way, or end the program, while it is imported.
    except (Exception, SystemExit) as error:
        raise PluginError(
            f"{what}: {reference} cannot be imported: {type(error).__name__}: {error}; "
            "correct its package, or uninstall it"
        ) from error
    if not isinstance(found, of):
        raise PluginError(f"{what}: {reference} is not of the class {of.__name__}")
    return found


def load(group: str, name: str) -> Any:
    """Import the object that is registered under a name; raises PluginError."""
    kind = CALLED.get(group, group)
    found = [*_entries(group).select(name=name)]
    if not found:
        there = f"there are {', '.join(names(group)) or 'none'}"
        hint = "; `pincette doctor --drivers` lists them" if group in (*DRIVERS, LAWS) else ""
        remedy = f"; {command}" if (command := installation(name)) else ""
        raise PluginError(f"no {kind} {name!r} is installed; {there}{hint}{remedy}")
    if len(found) > 1:
        both = " and ".join(sorted(origin(entry) for entry in found))
        raise PluginError(f"{kind} {name!r} is registered by {both}; uninstall all but one")
    (entry,) = found
    try:
        return entry.load()
    # A module from another package may fail in any way, or end the program, while it is imported.
    except (Exception, SystemExit) as error:
        raise PluginError(
            f"{kind} {name!r} ({entry.value}, {origin(entry)}) cannot be imported: "
            f"{type(error).__name__}: {error}"
        ) from error


def installation(name: str) -> str:
    """Return the command that installs the extra of pincette with this name, or an empty text."""
    try:
        wanted = requires("pincette") or []
    except PackageNotFoundError:  # only the client is installed
        return ""
    package = f"pincette-{name}=="
    found = any(one.startswith(package) for one in wanted)
    return f"pip install 'pincette[{name}]'" if found else ""
