"""The recorder program: takes what the bus brings, answers questions, keeps the folder in order."""

import logging
import queue
import secrets
import threading
from collections.abc import Callable
from time import monotonic, time
from typing import cast

from pincette import __version__
from pincette.bus.zenoh_bus import ZenohBus
from pincette.messages import Finish, Message, Record, Status
from pincette.runtime.context import Context
from pincette.runtime.priority import stand_back
from pincette.topics import FINISH, RECORD, STATUS, TOPICS, Question
from pincette_recorder import mending, retention
from pincette_recorder.config import RecorderConfig, configure
from pincette_recorder.intake import Intake
from pincette_recorder.keeper import Keeper, Reply
from pincette_recorder.wall_clock import WallClock

log = logging.getLogger(__name__)
LOOK_S = 0.05
"""How often what has come is written."""
TIDY_S = 600.0


class Recorder:
    """A keeper at work in its own thread, the only one that touches files."""

    def __init__(self, config: RecorderConfig, bus: ZenohBus) -> None:
        self._config, self._bus = config, bus
        wall = WallClock()
        self._intake = Intake(wall.now_ns)
        self._keeper = Keeper(config, self._intake, clock_ns=wall.now_ns, wall=wall)
        self._asked: queue.SimpleQueue[tuple[Message, Reply]] = queue.SimpleQueue()
        self._instance = secrets.randbits(48)
        self._stopping = threading.Event()
        self._mended = self._deleted = 0
        self._tidy_at_s = monotonic()

    def serve(self) -> None:
        """Take samples and questions from the bus."""
        for topic in TOPICS:
            self._bus.subscribe(topic, self._intake.take)
        for question in (RECORD, FINISH):
            self._bus.serve(question, self._queue)
        self._bus.serve(STATUS["recorder"], self._tell)

    def _queue(self, _question: Question, request: Message, reply: Reply) -> None:
        self._asked.put((request, reply))

    def _tell(self, _question: Question, _request: Message, reply: Reply) -> None:
        reply(self._status())

    def _status(self) -> Status:
        keeper, record = self._keeper, self._keeper.record
        words = ["idle" if record is None else f"records job {record.job}"]
        lost = keeper.dropped + self._intake.dropped.total()
        for count, what in (
            (keeper.finished, "finished"),
            (self._mended, "closed after a crash"),
            (self._deleted, "old ones deleted"),
            (lost, "messages lost"),
        ):
            if count:
                words.append(f"{count} {what}")
        if record is not None and record.trouble:
            words.append(record.trouble)
        return Status(
            service="recorder",
            version=__version__,
            instance=self._instance,
            digest=self._config.digest,
            epoch=0 if record is None else record.epoch,
            steps=keeper.written,
            missed=lost,
            refused=self._bus.refused,
            detail="; ".join(words)[:380],
        )

    def work(self) -> None:
        """Write until told to stop; then close what is open."""
        try:
            while not self._stopping.is_set():
                self._answer_one()
                self._keeper.take()
                if self._keeper.record is None and monotonic() >= self._tidy_at_s:
                    self._tidy()
        finally:
            self._keeper.close()

    def _answer_one(self) -> None:
        try:
            request, reply = self._asked.get(timeout=LOOK_S)
        except queue.Empty:
            return
        if isinstance(request, Record):
            reply(self._keeper.begin(request))
        else:
            self._keeper.finish(cast(Finish, request), reply)
            self._tidy_at_s = min(self._tidy_at_s, monotonic() + 1.0)

    def _tidy(self) -> None:
        """Close what a crash has left open, then delete what shall not stay."""
        self._tidy_at_s = monotonic() + TIDY_S
        config = self._config
        try:
            for folder in mending.unclosed(config.records):
                mending.mend(folder, mending.KILLED)
                self._mended += 1
            retention.sweep(config.records)
            if config.keep_s is None and config.keep_bytes is None:
                return
            kept = retention.ended(config.records, but="")
            for name in retention.doomed(kept, time(), config.keep_s, config.keep_bytes):
                retention.delete(config.records, name)
                self._deleted += 1
        except OSError as error:
            log.error("%s: %s", config.records, error)

    def stop(self) -> None:
        """Ask the thread to end."""
        self._stopping.set()


def run(context: Context) -> None:
    """Record until told to stop."""
    config = configure(context.rig, context.data)
    if not context.rig.lockstep:
        stand_back()
    bus = context.open_bus()
    try:
        recorder = Recorder(config, bus)
        thread = threading.Thread(target=_until_it_ends(recorder, context), name="records")
        recorder.serve()
        thread.start()
        try:
            bus.announce("recorder")
            context.ready("keeps every sample of a job")
            context.stop.wait()
        finally:
            recorder.stop()
            thread.join()
    finally:
        bus.close()


def _until_it_ends(recorder: Recorder, context: Context) -> Callable[[], None]:
    """Work; where it ends by a fault, the program ends too, and says so."""

    def work() -> None:
        try:
            recorder.work()
        finally:
            context.stop.set()

    return work
