"""Begins, writes and finishes records, one at a time, in one thread and thus without a lock."""

import json
import logging
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from time import monotonic
from typing import Any, cast

from msgspec.structs import replace

from pincette.control.checks import require_positive
from pincette.core.files import make_folder
from pincette.core.messages import Ack, Finish, Record, Recorded
from pincette.core.topics import TOPIC_OF
from pincette.records import folder as files
from pincette_recorder import record_repair
from pincette_recorder.config import BYTES_PER_MB, RecorderConfig
from pincette_recorder.intake import Intake
from pincette_recorder.open_record import OpenRecord
from pincette_recorder.repairer import MOST_TEXT, RecordRepairer, Reply
from pincette_recorder.wall_clock import WallClock

log = logging.getLogger(__name__)
LAST_S, LAST_QUIET_S = 2.0, 0.3
"""Longest waits for a loop's last samples, in s: in total, and without any message."""
QUIET_S = 1.0
"""Time in s after which a silent loop no longer prevents the recording of another job."""
JOB_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")


class RecordWriter:
    """The records of one rig."""

    def __init__(
        self,
        config: RecorderConfig,
        intake: Intake,
        wall: WallClock,
        repairer: RecordRepairer,
        clock_s: Callable[[], float] = monotonic,
    ) -> None:
        self._config, self._intake = config, intake
        self._wall, self._repairer, self._clock_s = wall, repairer, clock_s
        self._finishing: tuple[Finish, Reply, float] | None = None
        self._beginning: tuple[Record, Reply, float] | None = None
        self.record: OpenRecord | None = None
        self.written = self.dropped = 0
        """Number of messages of all records since the start."""
        self._lack = ""
        self.finished = 0
        """Number of records closed since the start."""

    def begin(self, request: Record, reply: Reply) -> None:
        """Open a record, or write the tables of the open one; return the text of a refusal.

        While another job's loop is still running, the reply is sent later: the client may have
        received that loop's last sample before the recorder.
        """
        if self._beginning is not None:
            reply(f"job {self._beginning[0].job} is about to be recorded")
            return
        self._beginning = (request, reply, self._clock_s() + LAST_S)
        self.take()

    def _begin_in_turn(self, request: Record, reply: Reply, until_s: float) -> None:
        record, now_s = self.record, self._clock_s()
        other = record is not None and (record.job, record.epoch) != (request.job, request.epoch)
        if record is not None and other:
            playing = record.over_seq is None and now_s - record.alive_at_s < QUIET_S
            if now_s < until_s and (playing or self._finishing is not None):
                return
            self._beginning = None
            if playing:
                reply(f"job {record.job} is being recorded, and its motion still runs")
                return
        self._beginning = None
        reply(self._begin(request))

    def _begin(self, request: Record) -> Ack | str:
        if not JOB_NAME.fullmatch(request.job):
            return f"job = {request.job[:90]!r}: not a valid folder name"
        if request.epoch == 0:
            return "epoch = 0 is that of an idle loop: nothing to record"
        try:
            about = _texts(json.loads(request.about))
            period_s = float(about.get("period_s", self._config.period_s))
            require_positive("period_s", period_s, "s")
        except (TypeError, ValueError) as error:
            return f"about: {error}"
        digest = about.get("rig_file_digest", self._config.digest)
        if digest != self._config.digest:
            return (
                f"runs with rig file {self._config.digest}, the supervisor with {digest}: "
                "start all programs with the same file"
            )
        record = self.record
        if record is not None:
            if (record.job, record.epoch) == (request.job, request.epoch):
                wrong = record.tables()
                return "; ".join(wrong)[:MOST_TEXT] if wrong else Ack(0)
            self._close(f"job {request.job} began before this record was finished")
        try:
            return self._open(request, about, period_s)
        except OSError as error:
            return f"no record can be started in {self._config.records}: {error}"

    def _open(self, request: Record, about: Mapping[str, str], period_s: float) -> Ack | str:
        config = self._config
        make_folder(config.records)
        free = shutil.disk_usage(config.records).free
        if free < config.min_free_bytes:
            return (
                f"{free / BYTES_PER_MB:.0f} MB are free in {config.records}, must be at least "
                f"{config.min_free_bytes / BYTES_PER_MB:.0f} MB ([recorder] min_free_MB)"
            )
        self._wall.begin()
        now_ns = self._wall.now_ns()
        record = OpenRecord(
            config.records / request.job,
            config.rig,
            epoch=request.epoch,
            about={key: value for key, value in about.items() if key != "request"},
            period_s=period_s,
            every_tick=config.lockstep,
            start_ns=now_ns,
            now_s=self._clock_s(),
        )
        try:
            record.begin(self._documents(about), now_ns)
        except OSError as error:
            record.abandon(error)
            raise
        self.record = record
        self._intake.open(request.job, request.epoch)
        return Ack(0)

    def _documents(self, about: Mapping[str, str]) -> dict[str, str]:
        """Return the documents to store in the record's file: request, rig file and model."""
        found = {"rig.json": self._config.rig_file}
        if "request" in about:
            found[files.REQUEST] = about["request"]
        digest = about.get("model_digest", "")
        if digest.isalnum():
            for path in sorted(self._config.models.glob(f"*-{digest}.json")):
                found["model.json"] = path.read_text(encoding="utf-8")
        return found

    @property
    def idle(self) -> bool:
        """True while no record is open and none is about to be opened."""
        return self.record is None and self._beginning is None

    @property
    def lack(self) -> str:
        """Return the losses of the newest record that has lost messages; empty if none has."""
        dropped = self._intake.dropped
        return _lack(self.record.job, _not_kept(dropped)) if self.record and dropped else self._lack

    def take(self) -> None:
        """Write new messages, detect a silent loop, and open a waiting record."""
        self._write_arrivals()
        if self._beginning is not None:
            self._begin_in_turn(*self._beginning)

    def _write_arrivals(self) -> None:
        record = self.record
        if record is None:
            return
        now_s = self._clock_s()
        self._wall.look()
        for arrival_ns, message in self._intake.drain():
            record.put(TOPIC_OF[type(message)].name, message, arrival_ns, now_s)
            self.written += 1
        record.flush_aged(self._wall.now_ns())
        if self._finishing is not None:
            request, _, until_s = self._finishing
            reached = record.reached(request.last_seq)
            quiet = reached and now_s - record.heard_at_s >= LAST_QUIET_S
            if quiet or record.has(request.last_seq):
                self._close("")
            elif now_s >= until_s:
                late = f"sample {request.last_seq} did not come within {LAST_S:g} s"
                self._close("" if reached else late)
        elif now_s - record.alive_at_s > self._config.silence_s:
            if record.over_seq is None:
                self._close(f"the loop was silent for {self._config.silence_s:g} s")
            else:
                self._close("the record was not finished: did the supervisor end?")

    def finish(self, request: Finish, reply: Reply) -> None:
        """Close a record as soon as its last samples have arrived; the reply may be sent later."""
        record = self.record
        if record is None or (record.job, record.epoch) != (request.job, request.epoch):
            if JOB_NAME.fullmatch(request.job):
                self._repairer.tell_end(request, reply)
            else:
                reply(f"job = {request.job[:90]!r}: not a valid folder name")
            return
        self._finishing = (request, reply, self._clock_s() + LAST_S)
        self.take()

    def _close(self, why: str) -> None:
        """Write the tables of the open record and close it.

        ``why`` is the reason if it is incomplete.
        """
        record = cast(OpenRecord, self.record)
        self.record = None
        self._intake.close()
        dropped = self._intake.dropped + record.refused
        lack = [*_not_kept(dropped), *record.tables()]
        wrong = [text for text in (why, record.trouble, *lack) if text]
        stepped = self._wall.words()
        recorded = Recorded(
            job=record.job,
            messages=record.file.counts.total(),
            dropped=dropped.total() + record.missing,
            complete=not wrong,
            detail="; ".join([*wrong, stepped] if stepped else wrong)[:MOST_TEXT],
        )
        closing = {
            "messages": str(recorded.messages),
            "dropped": str(recorded.dropped),
            "complete": "false" if wrong else "true",
            "detail": recorded.detail,
            **record.times,
            **{f"messages_{topic}": str(n) for topic, n in sorted(record.file.counts.items())},
            **{f"dropped_{topic}": str(count) for topic, count in sorted(dropped.items())},
        }
        if trouble := record.finish(closing):
            recorded = _lacking(recorded, trouble)
            closing |= {"complete": "false", "detail": recorded.detail}
        if trouble := self._write_manifest(record, closing):
            recorded = _lacking(recorded, trouble)
        if not recorded.complete:
            log.warning("%s: %s", record.job, recorded.detail, extra={"job": record.job})
        self.finished += 1
        self.dropped += recorded.dropped
        if recorded.dropped:
            self._lack = _lack(record.job, lack)
        if self._finishing is not None:
            _, reply, _ = self._finishing
            self._finishing = None
            reply(recorded)

    def _write_manifest(self, record: OpenRecord, closing: Mapping[str, str]) -> str:
        """Write the manifest, which states how the record ended; return the reason if that fails.

        The supervisor may have ended, so its journal may not contain this.
        """
        try:
            record_repair.write_manifest(record.folder, record.about, closing)
        except OSError as error:
            return f"the manifest cannot be written: {error}"
        self._repairer.note_written(record.folder.name)
        return ""

    def close(self) -> None:
        """Close the open record before the program ends."""
        self.take()
        if self.record is not None:
            self._close("the recorder was ended")


def _not_kept(dropped: Mapping[str, int]) -> list[str]:
    return [
        f"{count} messages of {topic} could not be stored"
        for topic, count in sorted(dropped.items())
    ]


def _lack(job: str, lack: Sequence[str]) -> str:
    return f"the record of job {job} lacks messages: {', '.join(lack)}"


def _lacking(recorded: Recorded, trouble: str) -> Recorded:
    """Return the reply for an incomplete record, with the first reason why it is incomplete."""
    detail = recorded.detail if not recorded.complete else trouble
    return replace(recorded, complete=False, detail=detail[:MOST_TEXT])


def _texts(tree: Any) -> dict[str, str]:
    if not isinstance(tree, dict):
        raise TypeError("not a map of names and texts")
    pairs = cast("dict[str, Any]", tree)
    odd = [name for name, value in pairs.items() if not isinstance(value, str)]
    if odd:
        raise ValueError(f"no text: {', '.join(odd)[:90]}")
    return pairs
