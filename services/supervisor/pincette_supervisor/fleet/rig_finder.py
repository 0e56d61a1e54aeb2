"""Search for rigs on the router by their programs' liveliness tokens."""

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from math import inf
from time import monotonic
from typing import Protocol

from pincette.bus.protocol import BusError
from pincette.config import ConfigError, RigFile
from pincette.core.messages import RigFileReply
from pincette.core.topics import LOOP
from pincette.engine.rig_file import read_rig_reply
from pincette_supervisor.fleet.rigs import Rigs
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.store import StoreError

log = logging.getLogger(__name__)
FIRST_S = 4.0
"""Time in s that the supervisor waits at its start for rigs that are already running."""
SETTLE_S = 0.1
"""Time in s within which changes are handled together: the programs of a rig appear and
disappear together."""
AGAIN_S, AGAIN_MOST_S = 1.0, 30.0
"""Delay of the next check, in s.

A rig that is served and not ready is checked again after the first time. For a rig that cannot be
served, the delay starts at the first time and doubles with each further failure up to the second
time: any tool can hold the tokens of a rig that does not exist.
"""
WORKERS = 4
"""Number of rigs that are checked concurrently."""
JOIN_S = 2.0
ASKED_FIRST = ("actuator", *(name for name in LOOP if name != "actuator"))
"""Programs in the order of priority of their rig files."""


class AskRigFile(Protocol):
    """Interface for requests to rigs that are not served."""

    def rig_file(self, rig: str, program: str) -> RigFileReply:
        """Return the rig file with which a program of the loop runs; raises BusError."""
        ...


class Everywhere(Protocol):
    """Interface to the liveliness of the programs of every rig on the router."""

    def alive_everywhere(self) -> set[tuple[str, str]]:
        """Return the rigs and programs that are alive."""
        ...

    def watch_everywhere(self, sink: Callable[[str, str, bool], None]) -> None:
        """Call ``sink`` with rig and program whenever one appears (True) or disappears (False)."""
        ...


@dataclass(slots=True)
class FoundRig:
    """A rig that was found: its programs of the loop, and the time of its next check."""

    programs: set[str] = field(default_factory=set[str])
    here: bool = False
    due_s: float = inf
    """Time of the next check; infinite if none is due until its programs change."""
    failures: int = 0
    """Number of consecutive checks that found that the rig cannot be served."""
    busy: bool = False
    """True while the rig is being checked."""
    seen: threading.Event = field(default_factory=threading.Event)
    """Set once the rig has been checked."""


class RigFinder:
    """Serves every rig whose programs appear, in addition to the supervisor's own rig."""

    def __init__(
        self, rigs: Rigs, others: AskRigFile, create: Callable[[RigFile], JobManager]
    ) -> None:
        self._rigs, self._others, self._create = rigs, others, create
        self._changed = threading.Condition()
        self._found: dict[str, FoundRig] = {}
        self._workers: list[threading.Thread] = []
        self._closing = False

    def start(self, everywhere: Everywhere) -> None:
        """Serve the rigs that are alive, and after that those that appear."""
        try:
            for rig, program in everywhere.alive_everywhere():
                self.on_liveliness(rig, program, True)
        except BusError as error:  # the watch reports them later
            log.warning("%s", error)
        everywhere.watch_everywhere(self.on_liveliness)
        deadline = monotonic() + FIRST_S
        for found in list(self._found.values()):
            found.seen.wait(max(0.0, deadline - monotonic()))

    def on_liveliness(self, rig: str, program: str, alive: bool) -> None:
        """Note that a program appears or disappears; callable from any thread, without blocking."""
        if rig == self._rigs.own.name or program not in LOOP:
            return
        with self._changed:
            if self._closing:
                return
            found = self._found.setdefault(rig, FoundRig())
            (found.programs.add if alive else found.programs.discard)(program)
            found.due_s, found.failures = monotonic() + SETTLE_S, 0
            if len(self._workers) < min(WORKERS, len(self._found)):
                number = len(self._workers) + 1
                worker = threading.Thread(
                    target=self._work, name=f"finds-rigs-{number}", daemon=True
                )
                self._workers.append(worker)
                worker.start()
            self._changed.notify()

    def _work(self) -> None:
        while True:
            with self._changed:
                rig = self._next_due()
                if rig is None:
                    return
                found = self._found[rig]
                found.busy, found.due_s = True, inf
            again_s = self._again_s(rig, found)
            found.seen.set()
            with self._changed:
                found.busy = False
                found.due_s = min(found.due_s, monotonic() + again_s)
                if not found.programs and found.due_s == inf and self._rigs.find(rig) is None:
                    del self._found[rig]
                self._changed.notify()

    def _next_due(self) -> str | None:
        """Wait until a rig is due, and return it; rigs with the fewest failures come first. Return
        None when the finder is closed.
        """
        while not self._closing:
            now_s = monotonic()
            free = [(rig, found) for rig, found in self._found.items() if not found.busy]
            due = [
                (found.failures, found.due_s, rig) for rig, found in free if found.due_s <= now_s
            ]
            if due:
                return min(due)[2]
            next_s = min((found.due_s for _, found in free), default=inf)
            self._changed.wait(None if next_s == inf else next_s - now_s)
        return None

    def _again_s(self, rig: str, found: FoundRig) -> float:
        """Check a rig; return the time until the next check, infinite if none is needed."""
        try:
            return inf if self._check(rig, found) else AGAIN_S
        except (BusError, ConfigError, StoreError) as error:
            self._refuse(rig, str(error))
            if isinstance(error, ConfigError):
                return inf
        except Exception as error:  # the thread continues, and checks the rig again
            log.exception("rig %s cannot be checked", rig)
            self._refuse(rig, f"the supervisor has a fault, see its log: {error}")
        if self._rigs.find(rig) is not None:
            return AGAIN_S
        with self._changed:
            found.failures += 1
            return min(AGAIN_MOST_S, AGAIN_S * 2.0 ** (found.failures - 1))

    def _check(self, rig: str, found: FoundRig) -> bool:
        """Check a rig whose programs have changed; return False if it must be checked again."""
        with self._changed:
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
            words = "its programs run again" if programs else "its programs have stopped"
            manager.context.events.append("rig", None, found=words)
        return not programs or self._compare(manager, self._request_rig_files(rig, programs))

    def _request_rig_files(self, rig: str, programs: set[str]) -> Mapping[str, RigFileReply]:
        """Return the rig files of the programs; raises BusError if none replies."""
        replies: dict[str, RigFileReply] = {}
        trouble = ""
        for program in ASKED_FIRST:
            if program in programs:
                try:
                    replies[program] = self._others.rig_file(rig, program)
                except BusError as error:
                    trouble = str(error)
        if not replies:
            raise BusError(f"its rig file is not known: {trouble}")
        return replies

    def _read(self, rig: str, replies: Mapping[str, RigFileReply]) -> RigFile:
        """Return the rig file with the highest priority.

        Raises ConfigError if it does not permit serving the rig.
        """
        program, first = next(iter(replies.items()))
        try:
            file = read_rig_reply(first)
        except ConfigError as error:
            raise ConfigError(f"the rig file of its {program} is not valid:\n{error}") from error
        if file.rig.name != rig or not file.joins:
            raise ConfigError(
                f"the rig file of its {program} names rig {file.rig.name!r} with "
                f"[bus] router = {file.bus.router!r}: it is served by a supervisor of its own"
            )
        return file

    def _serve(self, file: RigFile, word: str) -> None:
        manager = self._create(file)
        # Published before the rig is served, so that a client that sees the rig finds the event.
        found = {"found": word, "digest": manager.context.digest}
        manager.context.write_queue.submit(
            partial(manager.context.events.append, "rig", None, **found)
        )
        with self._changed:
            late = self._closing
            if not late:
                self._rigs.add(manager)
        if late:
            _end(manager)

    def _compare(self, manager: JobManager, replies: Mapping[str, RigFileReply]) -> bool:
        """Reopen a rig if its programs agree on another rig file; return False if the rig is still
        busy.
        """
        health, before = manager.context.health, manager.context.model.file
        if len({one.text for one in replies.values()}) > 1:
            return True  # each program's status reports it
        file = self._read(manager.name, replies)
        health.changed = (
            ""
            if file.digest() == before.digest()
            else f"its programs run with rig file {file.digest()}, jobs here use "
            f"{before.digest()}: the rig is reloaded once no job runs or waits"
        )
        if file == before:
            return True
        if not manager.retire():
            return False
        self._serve(file, "reloaded with another rig file")
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
        """Stop serving further rigs."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        deadline = monotonic() + JOIN_S
        for worker in self._workers:
            worker.join(max(0.0, deadline - monotonic()))


def _end(manager: JobManager) -> None:
    manager.close()
    manager.release()
