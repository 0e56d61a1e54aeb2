"""A supervisor of several simulated rigs that appear and disappear on one router."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pincette.bus.protocol import AbsentError
from pincette.config import RigFile
from pincette.core.messages import Message
from pincette.core.topics import LOOP, Request
from pincette_supervisor.fleet.rig_finder import RigFinder
from pincette_supervisor.fleet.rigs import RigFactory, Rigs
from pincette_supervisor.journal.events import Listeners
from pincette_supervisor.rigs.latch import OtherRigs
from tests.support.apps import create_app
from tests.support.stores import open_store

from .canned import CannedRig
from .harness import Harness, played_once

Turn = Callable[[str, str, bool], None]


def joined(own: RigFile, name: str, **limits: float) -> RigFile:
    """Return a rig like another one, which joins that one's router."""
    changes: dict[str, Any] = {
        "rig": own.rig.model_copy(update={"name": name}),
        "bus": own.bus.model_copy(update={"router": f"{own.bus.host}:{own.bus.port}"}),
        "limits": own.limits.model_copy(update=limits),
    }
    return own.model_copy(update=changes)


@dataclass
class CannedOthers:
    """A bus that reaches the programs of simulated rigs; other names have a token and no
    program."""

    canned: dict[str, CannedRig]
    asked: list[str] = field(default_factory=list[str])
    """Rigs to which requests were sent."""
    closed: bool = False

    def call(
        self,
        question: Request,
        request: Message,
        timeout_s: float = 2.0,
        *,
        rig: str | None = None,
    ) -> Message:
        assert rig is not None
        self.asked.append(rig)
        if rig not in self.canned:
            raise AbsentError(f"{rig}: no program answers")
        return self.canned[rig].call(question, request, timeout_s)

    def close(self) -> None:
        self.closed = True


class RigsHarness(Harness):
    """The harness of a supervisor whose own rig is always there."""

    def __init__(self, own: RigFile, data: Path) -> None:
        self.own, self.data = own, data
        self.canned: dict[str, CannedRig] = {}
        self.turns: list[Turn] = []
        self.store = open_store(data / "supervisor.sqlite")
        self.listeners = Listeners()
        factory = RigFactory(self.store, self.listeners, data, self.open_bus, play=played_once)
        self.make(own)
        self.rigs = Rigs(factory.create(own), lambda rigs, limit_s: self.others.stop(rigs, limit_s))
        self.at(own.rig.name)
        self.opened: list[CannedOthers] = []
        """Sessions to rigs that are not served, in the order in which they were opened."""
        self.others = OtherRigs(self.open_others)
        self.finder = RigFinder(self.rigs, self.others, factory.create)
        self.finder.start(self)
        self.app = create_app(self.rigs)

    def make(self, file: RigFile) -> CannedRig:
        """Start a new instance of a rig."""
        made = CannedRig(file)
        made.records = file.home(self.data) / "jobs"
        self.canned[file.rig.name] = made
        return made

    def open_bus(self, rig: str, *, lockstep: bool) -> CannedRig:  # noqa: ARG002  as a bus is asked for
        return self.canned[rig]

    def open_others(self) -> "CannedOthers":
        self.opened.append(CannedOthers(self.canned))
        return self.opened[-1]

    def alive_everywhere(self) -> set[tuple[str, str]]:
        return {(rig, program) for rig in self.canned for program in LOOP}

    def watch_everywhere(self, sink: Turn) -> None:
        self.turns.append(sink)

    def come(self, file: RigFile) -> CannedRig:
        """Start the programs of a rig."""
        made = self.make(file)
        self.turn(file.rig.name, alive=True)
        return made

    def go(self, rig: str) -> None:
        """Stop the programs of a rig."""
        self.canned[rig].silent.update(LOOP)
        self.turn(rig, alive=False)

    def turn(self, rig: str, *, alive: bool) -> None:
        for sink in self.turns:
            for program in LOOP:
                sink(rig, program, alive)

    def at(self, rig: str) -> None:
        """Use a rig from here on."""
        self.bus, self.manager = self.canned[rig], self.rigs.get(rig)

    def names(self) -> list[str]:
        return [rig["name"] for rig in self.get("/rigs")["rigs"]]

    def served(self, rig: str) -> None:
        """Wait until a rig is served."""
        self.until(lambda: rig in self.names())

    def found(self, rig: str) -> list[str]:
        """Events about rigs that appear and disappear."""
        rows = self.store.events_after(0, rig=rig)
        return [row.body["found"] for row in rows if row.kind == "rig" and "found" in row.body]

    def close(self) -> None:
        self.finder.close()
        self.others.close()
        self.rigs.close()
        self.listeners.close()
        self.rigs.release()
        self.store.close()
