"""A supervisor of a virtual rig, whose background activity advances step by step under control of a
test.

It can be killed wherever the thread of a job waits, and after any of its writes.
"""

import threading
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from sqlalchemy import Connection

from pincette.bus.protocol import BusError, RequestHandler, Sink
from pincette.bus.refused import RefusedMessages
from pincette.core.messages import Message
from pincette.core.topics import Request, Topic
from pincette_supervisor.jobs import job_manager as job_manager_module
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.events import EventLog
from pincette_supervisor.journal.store import Store, StoreError, utc_now
from pincette_supervisor.model import RigModel
from pincette_supervisor.plugin.drawing import Picture
from pincette_supervisor.results import archive
from pincette_supervisor.rigs import latch
from pincette_supervisor.rigs.health import PROGRAMS, Health
from pincette_supervisor.rigs.observer import Observer
from pincette_supervisor.rigs.rig_context import RigContext
from tests.support.steps import AtOnce, KilledError, SteppedJob, SteppedLock, Steps
from tests.support.virtual_rig import VirtualRig


class Line:
    """The bus as one supervisor sees it: silent after that supervisor is killed."""

    def __init__(self, steps: Steps) -> None:
        self._steps, self._rig = steps, steps.rig
        self.asked: list[Message] = []
        """Requests of a job's thread or of a person, in order."""

    def publish(self, message: Message) -> None:
        with self._rig.turn:
            self._rig.bus.publish(message)

    refused = RefusedMessages("supervisor")

    def subscribe(self, topic: Topic, sink: Sink) -> None:
        def hear(topic: Topic, message: Message) -> None:
            if not self._steps.killed:
                sink(topic, message)

        with self._rig.turn:
            self._rig.bus.subscribe(topic, hear)

    def latest(self, topic: Topic, timeout_s: float = 1.0) -> Message | None:
        with self._rig.turn:
            return self._rig.bus.latest(topic, timeout_s)

    def serve(self, question: Request, answerer: RequestHandler) -> None:
        raise NotImplementedError(f"{question} {answerer}")

    def call(self, question: Request, request: Message, timeout_s: float = 2.0) -> Message:
        self._steps.rest()
        if self._steps.killed:
            raise BusError(f"killed before {question.name} was asked within {timeout_s:g} s")
        self.asked.append(request)
        return self._rig.call(question, request)

    def watch(self, sink: Callable[[str, bool], None]) -> None:
        for program in (*PROGRAMS, "rig"):
            sink(program, True)

    def close(self) -> None:
        """Do nothing: there is no connection to close."""


class MortalStore(Store):
    """A journal that kills its supervisor after a number of writes."""

    def __init__(self, path: Path, steps: Steps) -> None:
        self._steps = steps
        self.writes_left: int | None = None
        self._depth = 0
        super().__init__(path)

    @staticmethod
    def _killed() -> BaseException:
        """Return the error of a write after the end; a plain Exception would not end the
        journal's thread."""
        if threading.current_thread().name == "journal":
            return StoreError("the supervisor was killed")
        return KilledError()

    @contextmanager
    def writing(self) -> Generator[Connection]:
        if self._steps.killed:
            raise self._killed()
        with self._turn:
            with super().writing() as connection:
                self._depth += 1
                try:
                    yield connection
                finally:
                    self._depth -= 1
            if self.writes_left is not None and self._depth == 0:
                self.writes_left -= 1
                if self.writes_left < 0:
                    self._steps.killed = True
                    raise self._killed()


class SteppedHealth(Health):
    """A job waits for the test before it requests the state of all programs."""

    steps: Steps

    def refresh(self, *, force: bool = False) -> None:
        self.steps.rest()
        super().refresh(force=force)


def _no_picture(*_given: object, **_named: object) -> Picture:
    """Draw nothing, since drawing takes longer than all the rest."""
    return Picture(b"")


class _Threading:
    """The module ``threading`` with threads that the test can stop."""

    def __init__(self, thread: Callable[..., threading.Thread]) -> None:
        self.Thread = thread

    def __getattr__(self, name: str) -> Any:
        return getattr(threading, name)


class Office:
    """One supervisor, from its start to its end, on the data that an earlier one may have left."""

    def __init__(self, rig: VirtualRig, data: Path) -> None:
        self.rig, self.steps = rig, Steps(rig)
        steps = self.steps
        self.faults: list[BaseException] = []
        """Exceptions that have ended threads of jobs."""
        self.line = Line(steps)
        self.store = MortalStore(data / "supervisor.sqlite", steps)

        def now_s() -> float:
            return rig.now_s

        self.observer = Observer(self.line, now_s)
        self.health = SteppedHealth(rig.rig, self.line, self.observer, self.store, now_s)
        self.health.steps = steps
        self.events = EventLog(self.store, rig.rig.rig.name)
        context = RigContext(
            model=RigModel(rig.rig, data / "models", self.store),
            bus=self.line,
            observer=self.observer,
            health=self.health,
            store=self.store,
            events=self.events,
            records=data / "jobs",
            archivist=AtOnce(),
            clock=now_s,
        )
        vars(context)["closer"] = AtOnce()
        with patch.object(latch, "ThreadPoolExecutor", AtOnce):
            self.manager = JobManager(context)
        vars(self.manager)["_lock"] = SteppedLock(steps)
        self._patches = ExitStack()
        for target, name, stepped in (
            (job_manager_module, "LiveJob", self._live_job),
            (job_manager_module, "threading", _Threading(self._thread)),
            (archive, "picture", _no_picture),
        ):
            self._patches.enter_context(patch.object(target, name, stepped))
        self.health.refresh()
        self.manager.recover(self.store.interrupt_unfinished(utc_now()))

    def _thread(self, **given: Any) -> threading.Thread:
        run = given.pop("target")

        def until_killed(*args: Any) -> None:
            try:
                run(*args)
            except BaseException as error:  # noqa: BLE001  whatever it is, the test looks at it
                if not self.steps.killed:
                    self.faults.append(error)
            finally:
                self.steps.ended()

        thread = threading.Thread(target=until_killed, **given)
        self.steps.threads.add(thread)
        return thread

    def _live_job(self, *args: Any) -> SteppedJob:
        return SteppedJob(*args, steps=self.steps)

    def kill(self) -> None:
        """Kill the supervisor without a shutdown."""
        self.steps.killed = True
        self._leave()

    def end(self) -> None:
        """Shut down in order: a running job is interrupted."""
        self.steps.free = True
        self.manager.close()
        self._leave()

    def _leave(self) -> None:
        for thread in self.steps.threads:
            thread.join(self.steps.guard_s)
            assert not thread.is_alive(), f"thread {thread.name} computes for too long"
        self._patches.close()
        self.manager.latch.close()
        self.manager.release()
        self.events.listeners.close()
        self.store.close()
