"""What a program that is no service of the loop is given when it is started."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile


class OpenBus(Protocol):
    """Joins the bus of the rig file's rig, or of another one that is named."""

    def __call__(self, rig: str | None = None, *, lockstep: bool | None = None) -> ZenohBus:
        """Join; raises BusError. ``lockstep`` is the named rig's; None: as in the rig file."""
        ...


@dataclass(frozen=True)
class Context:
    """Rig file, bus and life cycle of a program.

    A program registered under ``pincette.programs`` is a function of this context that returns
    when ``stop`` is set; it raises an error whose text an operator can read where it cannot start.
    """

    rig: RigFile
    data: Path
    """Folder for records and the store."""
    open_bus: OpenBus
    """Join the bus as a client of the router; the program closes it."""
    ready: Callable[[str], None]
    """Say, in one line, that the program serves."""
    stop: threading.Event
