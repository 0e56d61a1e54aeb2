"""Services, programs and drivers by entry point, imported late."""

from importlib.metadata import EntryPoint, entry_points
from typing import Any

SERVICES = "pincette.services"
PROGRAMS = "pincette.programs"
KEYS = "pincette.keys"
POSITION_SENSORS = "pincette.position_sensors"
VOLTAGE_OUTPUTS = "pincette.voltage_outputs"

DRIVERS = {POSITION_SENSORS: "position sensor", VOLTAGE_OUTPUTS: "voltage output"}
"""Groups that a rig file chooses from, and what one of them is called."""


class PluginError(Exception):
    """No such plug-in, or it cannot be imported; the text says which there are, or why."""


def registered(group: str) -> list[EntryPoint]:
    """Everything registered in a group, by name; a name is there twice where two packages bring it.

    None of it is imported.
    """
    return sorted(entry_points(group=group), key=lambda entry: (entry.name, origin(entry)))


def names(group: str) -> list[str]:
    """Names registered in a group."""
    return sorted({entry.name for entry in entry_points(group=group)})


def origin(entry: EntryPoint) -> str:
    """Distribution that registers an entry, and its version."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "an unknown distribution"


def load(group: str, name: str) -> Any:
    """Import what is registered under a name.

    Raises
    ------
    PluginError
        Where the name is not registered, two distributions register it, or its module cannot be
        imported.
    """
    kind = DRIVERS.get(group, group)
    found = [entry for entry in registered(group) if entry.name == name]
    if not found:
        there = f"there are {', '.join(names(group)) or 'none'}"
        hint = "; `pincette drivers` lists them" if group in DRIVERS else ""
        raise PluginError(f"no {kind} {name!r} is installed; {there}{hint}")
    if len(found) > 1:
        both = " and ".join(origin(entry) for entry in found)
        raise PluginError(f"{kind} {name!r} is registered by {both}; uninstall all but one")
    (entry,) = found
    try:
        return entry.load()
    # A module from outside may fail in any way, or end the program, while it is imported.
    except (Exception, SystemExit) as error:
        raise PluginError(
            f"{kind} {name!r} ({entry.value}, {origin(entry)}) cannot be imported: "
            f"{type(error).__name__}: {error}"
        ) from error
