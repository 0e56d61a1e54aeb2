"""Finds the rigs on the router by the tokens of their programs, and takes them up.

Each rig has a thread of its own here, so that one whose programs hang keeps no other waiting.
"""

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import monotonic
from typing import Protocol

from pincette.bus.protocol import BusError
from pincette.config import ConfigError, RigFile
from pincette.messages import RigFileTold
from pincette.runtime.rig_file import ask_rig_file, read_told
from pincette.topics import LOOP
from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.rigs import Rigs
from pincette_supervisor.running.taking_up import OpenBus

log = logging.getLogger(__name__)
FIRST_S = 4.0
"""How long the supervisor waits, at its start, for the rigs that are there already."""
SETTLE_S = 0.1
"""Programs of one rig come and go together: they are looked at once."""
AGAIN_S = 1.0
"""After this long a rig is looked at again that was not ready to be taken up."""
JOIN_S = 2.0
ASKED_FIRST = ("actuator", *(name for name in LOOP if name != "actuator"))
"""Whose word about the rig file counts first."""


class Everywhere(Protocol):
    """Tells of the programs of every rig on the router."""

    def alive_everywhere(self) -> set[tuple[str, str]]:
        """Rigs and programs that are there."""
        ...

    def watch_everywhere(self, sink: Callable[[str, str, bool], None]) -> None:
        """Tell ``sink`` of rig and program whenever one comes (true) or goes (false)."""
        ...


@dataclass(slots=True)
class Found:
    """A rig that was found: its programs of the loop, and who looks after it."""

    programs: set[str] = field(default_factory=set[str])
    here: bool = False
    woken: threading.Event = field(default_factory=threading.Event)
    seen: threading.Event = field(default_factory=threading.Event)
    """Set once it has been looked at."""
    thread: threading.Thread | None = None


class RigFinder:
    """Takes up every rig whose programs come, but for the supervisor's own."""

    def __init__(
        self, rigs: Rigs, open_bus: OpenBus, take_up: Callable[[RigFile], Conductor]
    ) -> None:
        self._rigs, self._open_bus, self._take_up = rigs, open_bus, take_up
        self._lock = threading.Lock()
        self._found: dict[str, Found] = {}
        self._closing = threading.Event()

    def begin(self, everywhere: Everywhere) -> None:
        """Take up what is there, and from then on what comes."""
        for rig, program in everywhere.alive_everywhere():
            self.turn(rig, program, True)
        everywhere.watch_everywhere(self.turn)
        deadline = monotonic() + FIRST_S
        for found in list(self._found.values()):
            found.seen.wait(max(0.0, deadline - monotonic()))

    def turn(self, rig: str, program: str, alive: bool) -> None:
        """Note that a program has come or gone; from any thread, at once."""
        if rig == self._rigs.own.name or program not in LOOP:
            return
        with self._lock:
            if self._closing.is_set():
                return
            found = self._found.setdefault(rig, Found())
            (found.programs.add if alive else found.programs.discard)(program)
            found.woken.set()
            if found.thread is None:
                found.thread = threading.Thread(
                    target=self._look_after, args=(rig, found), name=f"finds-{rig}", daemon=True
                )
                found.thread.start()

    def _look_after(self, rig: str, found: Found) -> None:
        done = False
        while True:
            found.woken.wait(None if done else AGAIN_S)
            if self._closing.wait(SETTLE_S):
                return
            found.woken.clear()
            try:
                done = self._look(rig, found)
            except (BusError, ConfigError, StoreError) as error:
                done = isinstance(error, ConfigError)
                self._refuse(rig, str(error))
            found.seen.set()

    def _look(self, rig: str, found: Found) -> bool:
        """See to a rig whose programs have come or gone; false where it must be done again."""
        with self._lock:
            programs = set(found.programs)
        conductor = self._rigs.known(rig)
        here, found.here = found.here, bool(programs)
        if conductor is None:
            if not programs:
                self._rigs.put_unusable(rig, "")
                return True
            self._serve(self._read(rig, self._told(rig, programs)), "found")
            return True
        if here != found.here:
            words = "its programs have come back" if programs else "its programs have gone"
            conductor.site.events.tell("rig", None, found=words)
        return not programs or self._compare(conductor, self._told(rig, programs))

    def _told(self, rig: str, programs: set[str]) -> Mapping[str, RigFileTold]:
        """What the programs say about their rig file; raises BusError where none answers."""
        told: dict[str, RigFileTold] = {}
        trouble = ""
        bus = self._open_bus(rig, lockstep=False)
        try:
            for program in ASKED_FIRST:
                if program in programs:
                    try:
                        told[program] = ask_rig_file(bus, program)
                    except BusError as error:
                        trouble = str(error)
        finally:
            bus.close()
        if not told:
            raise BusError(f"its rig file is not known: {trouble}")
        return told

    def _read(self, rig: str, told: Mapping[str, RigFileTold]) -> RigFile:
        """The rig file that counts; raises ConfigError where nothing can be served by it."""
        program, first = next(iter(told.items()))
        try:
            file = read_told(first)
        except ConfigError as error:
            raise ConfigError(
                f"the rig file of its {program} is not understood:\n{error}"
            ) from error
        if file.rig.name != rig or not file.joins:
            raise ConfigError(
                f"the rig file of its {program} names rig {file.rig.name!r} with "
                f"[bus] router = {file.bus.router!r}: it is served by a supervisor of its own"
            )
        return file

    def _serve(self, file: RigFile, word: str) -> None:
        conductor = self._take_up(file)
        with self._lock:
            late = self._closing.is_set()
            if not late:
                self._rigs.put(conductor)
        if late:
            _end(conductor)
        else:
            conductor.site.events.tell("rig", None, found=word, digest=conductor.site.digest)

    def _compare(self, conductor: Conductor, told: Mapping[str, RigFileTold]) -> bool:
        """Take a rig up anew whose programs agree on another file, once it is idle."""
        health, before = conductor.site.health, conductor.site.model.file
        if len({one.text for one in told.values()}) > 1:
            return True  # what is known of each program says so
        file = self._read(conductor.name, told)
        health.changed = (
            ""
            if file.digest() == before.digest()
            else f"its programs run with rig file {file.digest()}, jobs here are of "
            f"{before.digest()}: it is taken up anew once no job has the rig and none waits"
        )
        if file == before:
            return True
        if not conductor.retire():
            return False
        self._serve(file, "taken up anew, with another rig file")
        _end(conductor)
        return True

    def _refuse(self, rig: str, why: str) -> None:
        conductor = self._rigs.known(rig)
        if conductor is not None:
            conductor.site.health.changed = why
        elif self._rigs.unusable.get(rig) != why:
            self._rigs.put_unusable(rig, why)
            log.warning("rig %s: %s", rig, why)

    def close(self) -> None:
        """Take up nothing more."""
        with self._lock:
            self._closing.set()
        deadline = monotonic() + JOIN_S
        for found in self._found.values():
            found.woken.set()
            if found.thread is not None:
                found.thread.join(max(0.0, deadline - monotonic()))


def _end(conductor: Conductor) -> None:
    conductor.close()
    conductor.release()
