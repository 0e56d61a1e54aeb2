"""Services, programs and drivers by entry point, imported late."""

from importlib.metadata import entry_points
from typing import Any

SERVICES = "pincette.services"
PROGRAMS = "pincette.programs"
POSITION_SENSORS = "pincette.position_sensors"
VOLTAGE_OUTPUTS = "pincette.voltage_outputs"


class PluginError(Exception):
    """No such plug-in, or it cannot be imported; the text says which there are, or why."""


def names(group: str) -> list[str]:
    """Names registered in a group."""
    return sorted({entry.name for entry in entry_points(group=group)})


def load(group: str, name: str) -> Any:
    """Import what is registered under a name.

    Raises
    ------
    PluginError
        Where the name is not registered, or its module cannot be imported.
    """
    for entry in entry_points(group=group, name=name):
        try:
            return entry.load()
        except (ImportError, AttributeError) as error:
            raise PluginError(
                f"{group} {name!r} ({entry.value}) cannot be imported: {error}"
            ) from error
    raise PluginError(f"{group}: no {name!r}; there are {', '.join(names(group)) or 'none'}")
