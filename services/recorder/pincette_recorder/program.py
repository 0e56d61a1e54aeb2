"""Recorder program: records the messages of the bus, and maintains the folder of records."""

import logging
import queue
import secrets
import threading
from contextlib import closing
from time import monotonic
from typing import cast

from pincette import __version__
from pincette.bus.zenoh_bus import ZenohBus
from pincette.core.faults import FaultCode, fault
from pincette.core.messages import Finish, Message, Record, Status
from pincette.core.topics import FINISH, RECORD, STATUS, TOPICS
from pincette.engine.program import Context
from pincette_recorder import record_repair
from pincette_recorder.background_sync import BEHIND_S
from pincette_recorder.config import RecorderConfig, configure
from pincette_recorder.intake import Intake
from pincette_recorder.record_writer import RecordWriter, Reply
from pincette_recorder.repairer import MOST_TEXT, RecordRepairer
from pincette_recorder.wall_clock import WallClock

log = logging.getLogger(__name__)
LOOK_S, IDLE_LOOK_S = 0.05, 1.0
"""Interval at which new messages are written, with and without an open record, in s."""
TIDY_S = 600.0


class Recorder:
    """Runs a record writer in its own thread, and a repairer of closed records in another."""

    def __init__(self, config: RecorderConfig, bus: ZenohBus) -> None:
        self._config, self._bus = config, bus
        wall = WallClock()
        self._intake = Intake(wall.now_ns)
        self._repairer = RecordRepairer(config)
        self._writer = RecordWriter(config, self._intake, wall, self._repairer)
        self._asked: queue.SimpleQueue[tuple[Message, Reply] | None] = queue.SimpleQueue()
        """Requests; None wakes the writing thread."""
        self._instance = secrets.randbits(48)
        self._tidy_at_s = monotonic()

    def serve(self) -> None:
        """Subscribe to samples, and serve requests from the bus."""
        for topic in TOPICS:
            self._bus.subscribe(topic, self._intake.take)
        for question in (RECORD, FINISH):
            self._bus.serve(question, lambda _, request, reply: self._asked.put((request, reply)))
        self._bus.serve(STATUS["recorder"], lambda _, _request, reply: reply(self._status()))

    def _status(self) -> Status:
        writer, record = self._writer, self._writer.record
        lost = writer.dropped + self._intake.dropped.total()
        counts = {
            "finished": writer.finished,
            "closed_after_a_crash": self._repairer.repaired,
            "old_ones_deleted": self._repairer.deleted,
            "messages_lost": lost,
        }
        doing = "idle" if record is None else f"records job {record.job}"
        doing = "; ".join(filter(None, (doing, writer.lack)))[:MOST_TEXT]
        counted = {name: float(count) for name, count in counts.items() if count}
        findings = [fault(FaultCode.RECORDER_STATE, doing, **counted)]
        if record is not None and record.trouble:
            findings.append(fault(FaultCode.RECORD_TROUBLE, record.trouble))
        if (behind_s := self._behind_s()) > BEHIND_S:
            findings.append(fault(FaultCode.RECORD_BEHIND, behind_s=behind_s, limit_s=BEHIND_S))
        if damaged := dict(self._repairer.damaged):
            words = "; ".join(f"{name}: {', '.join(names)}" for name, names in damaged.items())
            place = f"{self._config.records}: {words}"[:MOST_TEXT]
            findings.append(fault(FaultCode.RECORD_DAMAGED, place, records=float(len(damaged))))
        if (step_s := self._repairer.counted.step_s) is not None:
            findings.append(fault(FaultCode.CLOCK_STEPPED, step_s=step_s))
        if (refused := self._bus.refused.finding()) is not None:
            findings.append(refused)
        return Status(
            service="recorder",
            version=__version__,
            instance=self._instance,
            digest=self._config.digest,
            epoch=0 if record is None else record.epoch,
            steps=writer.written,
            missed=lost,
            refused=self._bus.refused.count,
            findings=tuple(findings),
        )

    def _behind_s(self) -> float:
        """Return the age of the oldest message that a power cut would lose now, in s."""
        record = self._writer.record
        unsynced_s = 0.0 if record is None else record.unsynced_s
        return max(unsynced_s, self._intake.waiting_s)

    def wake(self) -> None:
        """Wake the writing thread, so that it notices a stop."""
        self._asked.put(None)

    def work(self, stop: threading.Event) -> None:
        """Write until ``stop``, then close the open record; a fault stops the program too."""
        try:
            self._check_newest()
            while not stop.is_set():
                self._answer_one()
                self._repairer.counted.count()
                self._writer.take()
                if self._writer.record is None and monotonic() >= self._tidy_at_s:
                    self._tidy()
        finally:
            try:
                self._writer.close()
            finally:
                stop.set()
                self._repairer.close()

    def _answer_one(self) -> None:
        try:
            asked = self._asked.get(timeout=IDLE_LOOK_S if self._writer.idle else LOOK_S)
        except queue.Empty:
            return
        if asked is None:
            return
        request, reply = asked
        if isinstance(request, Record):
            self._writer.begin(request, reply)
        else:
            self._writer.finish(cast(Finish, request), reply)
            self._tidy_at_s = min(self._tidy_at_s, monotonic() + 1.0)

    def _check_newest(self) -> None:
        try:
            self._repairer.check_newest()
        except OSError as error:
            log.error("%s: %s", self._config.records, error)

    def _tidy(self) -> None:
        self._tidy_at_s = monotonic() + TIDY_S
        try:
            self._repairer.tidy(record_repair.unclosed(self._config.records))
        except OSError as error:
            log.error("%s: %s", self._config.records, error)


def run(context: Context) -> None:
    """Record until the program is stopped."""
    config = configure(context.rig, context.data)
    with closing(context.open_bus()) as bus:
        recorder = Recorder(config, bus)
        recorder.serve()
        thread = threading.Thread(target=recorder.work, args=[context.stop], name="records")
        thread.start()
        try:
            bus.announce("recorder")
            context.ready("keeps every sample of a job")
            context.stop.wait()
        finally:
            context.stop.set()
            recorder.wake()
            thread.join()
