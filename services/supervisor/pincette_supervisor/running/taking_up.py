"""Takes up a rig: everything that serves it, put together from its rig file."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Protocol

from pincette.config import RigFile
from pincette_supervisor.config import configure
from pincette_supervisor.journal.store import Store
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.planning.foretelling import Play
from pincette_supervisor.planning.prediction import played
from pincette_supervisor.results import archive
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.events import EventLog
from pincette_supervisor.running.health import Health
from pincette_supervisor.running.listeners import Listeners
from pincette_supervisor.running.observer import Observer, WatchedBus
from pincette_supervisor.running.site import Site


class OpenBus(Protocol):
    """Joins the bus of a rig."""

    def __call__(self, rig: str, *, lockstep: bool) -> WatchedBus:
        """Join; raises BusError."""
        ...


@dataclass(frozen=True)
class Household:
    """What the rigs of one supervisor share: the journal, its listeners, and the folder."""

    store: Store
    listeners: Listeners
    data: Path
    open_bus: OpenBus
    play: Play = played
    """Plays a plan on the model, wherever there is a processor to spare."""
    waking: Callable[[], float] | None = None
    """Stands still while this program does."""

    def take_up(self, rig: RigFile, left_over: Sequence[str] = ()) -> Conductor:
        """Serve a rig; each has a bus and threads of its own.

        Parameters
        ----------
        left_over
            Its jobs that the journal has just marked as interrupted, the newest last.

        Raises
        ------
        BusError
            Where its bus cannot be joined.
        """
        bus = self.open_bus(rig.rig.name, lockstep=rig.lockstep)
        try:
            conductor = Conductor(self._site(rig, bus), self.play)
            conductor.site.health.refresh()
            conductor.recover(list(left_over))
            conductor.alarm_watch.begin()
        except Exception:
            bus.close()
            raise
        return conductor

    def _site(self, rig: RigFile, bus: WatchedBus) -> Site:
        config = configure(rig, rig.home(self.data))
        observer = Observer(bus, monotonic, self.waking)
        return Site(
            model=RigModel(rig, config.models, self.store),
            bus=bus,
            observer=observer,
            health=Health(rig, bus, observer, self.store),
            store=self.store,
            events=EventLog(self.store, rig.rig.name, self.listeners),
            records=config.records,
            archivist=archive.archivist(),
        )
