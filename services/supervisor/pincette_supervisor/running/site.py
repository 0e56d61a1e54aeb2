"""Where jobs run: the rig with the model in use, its bus, and what is kept of both."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

from pincette.config import RigFile
from pincette_supervisor.journal.store import Store
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.running.events import EventLog
from pincette_supervisor.running.health import Health
from pincette_supervisor.running.observer import Observer, WatchedBus


@dataclass(frozen=True)
class Site:
    """Where jobs run."""

    model: RigModel
    bus: WatchedBus
    observer: Observer
    health: Health
    store: Store
    events: EventLog
    records: Path
    archivist: Executor
    """Where records are made; see ``archive.archivist``."""
    guard_s: float = 20.0
    """Lockstep: how long the loop may stand still by the clock on the wall, as a link of it may."""
    clock: Callable[[], float] = monotonic
    """What deadlines are held to."""

    @property
    def rig(self) -> RigFile:
        """The rig file with the model in use."""
        return self.model.rig

    def reasons(self) -> list[str]:
        """Why no job can start, the actuator's latch and a held part apart."""
        found = self.health.reasons()
        if self.model.trouble:
            found.append(f"model: {self.model.trouble}")
        return found

    @property
    def digest(self) -> str:
        """Of the rig file, which all programs must agree on."""
        return self.model.digest
