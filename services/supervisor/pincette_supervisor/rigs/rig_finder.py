"""Finds rigs on the router by their programs' liveliness tokens, and serves each in a thread."""

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from time import monotonic
from typing import Protocol

from pincette.bus.protocol import BusError
from pincette.config import ConfigError, RigFile
from pincette.core.messages import RigFileReply
from pincette.core.topics import LOOP
from pincette.engine.rig_file import ask_rig_file, read_rig_reply
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.store import StoreError
from pincette_supervisor.rigs.rigs import OpenBus, Rigs

log = logging.getLogger(__name__)
FIRST_S = 4.0
"""How long the supervisor waits at start for rigs that are already running."""
SETTLE_S = 0.1
"""Programs of one rig come and go together; changes within this time are handled at once."""
AGAIN_S = 1.0
"""After this time a rig that was not ready is checked again."""
JOIN_S = 2.0
ASKED_FIRST = ("actuator", *(name for name in LOOP if name != "actuator"))
"""Programs in the order in which their rig file counts."""


class Everywhere(Protocol):
    """Liveliness of the programs of every rig on the router."""

    def alive_everywhere(self) -> set[tuple[str, str]]:
        """Rigs and programs that are alive."""
        ...

    def watch_everywhere(self, sink: Callable[[str, str, bool], None]) -> None:
        """Tell ``sink`` of rig and program whenever one comes (true) or goes (false)."""
        ...


@dataclass(slots=True)
class FoundRig:
    """A rig that was found: its programs of the loop, and the thread that watches it."""

    programs: set[str] = field(default_factory=set[str])
    here: bool = False
    woken: threading.Event = field(default_factory=threading.Event)
    seen: threading.Event = field(default_factory=threading.Event)
    """Set once it has been checked."""
    thread: threading.Thread | None = None


class RigFinder:
    """Serves every rig whose programs appear, except the supervisor's own."""

    def __init__(
        self, rigs: Rigs, open_bus: OpenBus, create: Callable[[RigFile], JobManager]
    ) -> None:
        self._rigs, self._open_bus, self._create = rigs, open_bus, create
        self._lock = threading.Lock()
        self._found: dict[str, FoundRig] = {}
        self._closing = threading.Event()

    def start(self, everywhere: Everywhere) -> None:
        """Serve the rigs that are alive, and from then on those that appear."""
        for rig, program in everywhere.alive_everywhere():
            self.on_liveliness(rig, program, True)
        everywhere.watch_everywhere(self.on_liveliness)
        deadline = monotonic() + FIRST_S
        for found in list(self._found.values()):
            found.seen.wait(max(0.0, deadline - monotonic()))

    def on_liveliness(self, rig: str, program: str, alive: bool) -> None:
        """Note that a program has come or gone; from any thread, without blocking."""
        if rig == self._rigs.own.name or program not in LOOP:
            return
        with self._lock:
            if self._closing.is_set():
                return
            found = self._found.setdefault(rig, FoundRig())
            (found.programs.add if alive else found.programs.discard)(program)
            found.woken.set()
            if found.thread is None:
                found.thread = threading.Thread(
                    target=self._watch_rig, args=(rig, found), name=f"finds-{rig}", daemon=True
                )
                found.thread.start()

    def _watch_rig(self, rig: str, found: FoundRig) -> None:
        done = False
        while True:
            found.woken.wait(None if done else AGAIN_S)
            if self._closing.wait(SETTLE_S):
                return
            found.woken.clear()
            try:
                done = self._check(rig, found)
            except (BusError, ConfigError, StoreError) as error:
                done = isinstance(error, ConfigError)
                self._refuse(rig, str(error))
            except Exception as error:  # the thread goes on, and checks the rig again
                done = False
                log.exception("rig %s cannot be checked", rig)
                self._refuse(rig, f"the supervisor has a fault, see its log: {error}")
            found.seen.set()

    def _check(self, rig: str, found: FoundRig) -> bool:
        """Check a rig whose programs have come or gone; False if it must be checked again."""
        with self._lock:
            programs = set(found.programs)
        manager = self._rigs.find(rig)
        here, found.here = found.here, bool(programs)
        if manager is None:
            if not programs:
                self._rigs.set_unusable(rig, "")
                return True
            self._serve(self._read(rig, self._request_rig_files(rig, programs)), "found")
            return True
        if here != found.here:
            words = "its programs have come back" if programs else "its programs have gone"
            manager.context.events.append("rig", None, found=words)
        return not programs or self._compare(manager, self._request_rig_files(rig, programs))

    def _request_rig_files(self, rig: str, programs: set[str]) -> Mapping[str, RigFileReply]:
        """The rig files of the programs; raises BusError if none answers."""
        replies: dict[str, RigFileReply] = {}
        trouble = ""
        bus = self._open_bus(rig, lockstep=False)
        try:
            for program in ASKED_FIRST:
                if program in programs:
                    try:
                        replies[program] = ask_rig_file(bus, program)
                    except BusError as error:
                        trouble = str(error)
        finally:
            bus.close()
        if not replies:
            raise BusError(f"its rig file is not known: {trouble}")
        return replies

    def _read(self, rig: str, replies: Mapping[str, RigFileReply]) -> RigFile:
        """The rig file that counts; raises ConfigError if the rig cannot be served with it."""
        program, first = next(iter(replies.items()))
        try:
            file = read_rig_reply(first)
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
        manager = self._create(file)
        # Before it is served, so that whoever sees the rig finds the event.
        found = {"found": word, "digest": manager.context.digest}
        manager.context.write_queue.submit(
            partial(manager.context.events.append, "rig", None, **found)
        )
        with self._lock:
            late = self._closing.is_set()
            if not late:
                self._rigs.add(manager)
        if late:
            _end(manager)

    def _compare(self, manager: JobManager, replies: Mapping[str, RigFileReply]) -> bool:
        """Serve a rig anew once it is idle, if its programs agree on another rig file."""
        health, before = manager.context.health, manager.context.model.file
        if len({one.text for one in replies.values()}) > 1:
            return True  # each program's status reports it
        file = self._read(manager.name, replies)
        health.changed = (
            ""
            if file.digest() == before.digest()
            else f"its programs run with rig file {file.digest()}, jobs here are of "
            f"{before.digest()}: it is taken up anew once no job has the rig and none waits"
        )
        if file == before:
            return True
        if not manager.retire():
            return False
        self._serve(file, "taken up anew, with another rig file")
        _end(manager)
        return True

    def _refuse(self, rig: str, why: str) -> None:
        manager = self._rigs.find(rig)
        if manager is not None:
            manager.context.health.changed = why
        elif self._rigs.unusable.get(rig) != why:
            self._rigs.set_unusable(rig, why)
            log.warning("rig %s: %s", rig, why)

    def close(self) -> None:
        """Serve no further rigs."""
        with self._lock:
            self._closing.set()
        deadline = monotonic() + JOIN_S
        for found in self._found.values():
            found.woken.set()
            if found.thread is not None:
                found.thread.join(max(0.0, deadline - monotonic()))


def _end(manager: JobManager) -> None:
    manager.close()
    manager.release()
