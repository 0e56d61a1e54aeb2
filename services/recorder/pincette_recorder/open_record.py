"""Open record: its file, and the progress of its loop."""

import logging
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from pincette.core.files import make_folder, sync_folder
from pincette.core.messages import (
    Applied,
    Command,
    Estimate,
    Message,
    Position,
    RequestLog,
    Sample,
    Telemetry,
    Timing,
)
from pincette.core.topics import TIMING
from pincette.records.mcap_file import NAME, McapFile
from pincette.records.record_times import BEGIN, utc_text
from pincette.records.record_times import NAMES as TIMES
from pincette.records.tables import Tables, write_tables_of_file
from pincette_recorder.background_sync import BackgroundSync

log = logging.getLogger(__name__)
MADE = (Position, Estimate, Command, Telemetry, Applied)
"""Message types that the loop publishes for every sample."""
TIMING_S = 10.0
"""Interval in s at which the programs' timing is stored; each message includes the earlier ones."""


class OpenRecord:
    """Record of one epoch.

    Raises OSError if the record cannot begin. If the disk fills later, ``trouble`` states it.
    """

    def __init__(
        self,
        folder: Path,
        rig: str,
        *,
        epoch: int,
        about: Mapping[str, str],
        period_s: float,
        every_tick: bool,
        start_ns: int,
        now_s: float,
    ) -> None:
        """Begin a record; for ``every_tick`` see ``RowBlocks``."""
        self.job, self.epoch, self.folder = folder.name, epoch, folder
        self.about: dict[str, str] = {**about, BEGIN: utc_text(start_ns)}
        """Metadata of the record; the times of its samples are added with the tables."""
        make_folder(folder)
        self.file = McapFile(folder / NAME, rig, about=about, start_ns=start_ns, period_s=period_s)
        self._sync = BackgroundSync(self.file.duplicate())
        self._chunks = 0
        """Number of the file's chunks that were passed to the syncing thread."""
        self._tables = Tables(folder, self.about, period_s, every_tick=every_tick)
        self.trouble = ""
        """Reason why the disk accepts no more data; empty while it does."""
        self.refused: Counter[str] = Counter()
        """Number of messages that came after ``trouble`` or could not be stored, by topic."""
        self.over_seq: int | None = None
        """Number of the sample with which the actuator reported the end of the arming; None before
        that.
        """
        self.alive_at_s = self.heard_at_s = now_s
        """Time at which the loop last played; ``heard_at_s`` is the time of the last message."""
        self.missing = 0
        """Number of samples that are known to have been sent and never arrived; see ``losses``."""
        self._newest: dict[type[Message], int] = {}
        self._timings: dict[str, tuple[Timing, int]] = {}
        """Newest timing of each program that is not written yet, with its arrival in ns."""
        self._timed_at_s = now_s

    def begin(self, documents: Mapping[str, str], at_ns: int) -> None:
        """Write documents to the file, and sync its beginning to the disk; raises OSError."""
        for name, content in documents.items():
            self.file.attach(name, "application/json", content.encode(), at_ns)
        self.file.sync()
        sync_folder(self.folder)

    @property
    def unsynced_s(self) -> float:
        """Age of the oldest data that a power cut would lose now, in s."""
        return 0.0 if self.trouble else self._sync.unsynced_s

    def put(self, topic: str, message: Message, arrival_ns: int, now_s: float) -> None:
        """Write a message."""
        if isinstance(message, Timing):  # sent by idle loops too
            self._timings[message.service] = message, arrival_ns
            if now_s - self._timed_at_s >= TIMING_S:
                self._timed_at_s = now_s
                self._write_timings()
            return
        self.heard_at_s = now_s
        if isinstance(message, Sample | RequestLog):
            self._newest[type(message)] = message.seq
        if isinstance(message, Applied | Telemetry):
            ended = isinstance(message, Applied) and message.final
            if ended and message.seq >= 0 and self.over_seq is None:
                self.over_seq = message.seq
            if self.over_seq is None:
                self.alive_at_s = now_s
        self._write(topic, message, arrival_ns)

    def _write_timings(self) -> None:
        for message, arrival_ns in self._timings.values():
            self._write(TIMING.name, message, arrival_ns)
        self._timings.clear()

    def _write(self, topic: str, message: Message, arrival_ns: int) -> None:
        if self.trouble:
            self.refused[topic] += 1
            return
        try:
            self.file.add(message, arrival_ns)
            self._note_chunks()
            self._tables.add(message, arrival_ns)
        except ValueError as error:  # a number too large for the file format
            self.refused[topic] += 1
            self._log_error(f"a message of {topic} cannot be recorded: {error}")
        except OSError as error:
            self._give_up(error)

    def flush_aged(self, now_ns: int) -> None:
        """Write messages that have been in memory for too long."""
        if self.trouble:
            return
        if self._sync.error is not None:
            self._give_up(self._sync.error)
            return
        try:
            self.file.flush_aged(now_ns)
            self._note_chunks()
        except OSError as error:
            self._give_up(error)

    def _note_chunks(self) -> None:
        """Note chunks passed to the operating system since the last call, so that they are
        synced.
        """
        if self.file.chunks != self._chunks:
            self._chunks = self.file.chunks
            self._sync.note_write()

    def has(self, seq: int | None) -> bool:
        """Return whether all messages of a sample have arrived, each on its own link.

        If ``seq`` is None, the last sample is checked.
        """
        known = [one for one in (seq, self.over_seq) if one is not None]
        return bool(known) and all(self._newest.get(kind, -2) >= min(known) for kind in MADE)

    def reached(self, seq: int | None) -> bool:
        """Return whether any message of a sample has arrived. This is also possible if one of the
        programs was terminated and sends no more messages.
        """
        return seq is None or max(self._newest.values(), default=-2) >= seq

    def tables(self) -> list[str]:
        """Write the tables of the record so far; return their errors."""
        self._write_timings()
        try:
            if not self.trouble:
                self.file.flush()
                self._note_chunks()
                wrong, missing = self._tables.write(), self._tables.missing
                times = self._tables.times
            else:  # the file may lack messages that are in the tables
                self._tables.close()
                written = write_tables_of_file(self.folder)
                wrong, missing, times = written.wrong, written.missing, written.times
        except (OSError, ValueError) as error:
            return [f"no table: {error}"]
        self.about |= times
        wrong += [
            f"{count} messages of {topic} were not received" for topic, count in missing.items()
        ]
        self.missing = sum(missing.values())
        return wrong

    @property
    def times(self) -> dict[str, str]:
        """UTC times of the record at the last write of its tables."""
        return {name: self.about[name] for name in TIMES if name in self.about}

    def finish(self, closing: Mapping[str, str]) -> str:
        """Close the file; return the reason if that is not possible."""
        self._tables.close()
        self._sync.stop()
        if not self.trouble:
            try:
                if self._sync.error is not None:
                    raise self._sync.error
                self.file.finish(closing)
            except OSError as error:
                self._give_up(error)
        return self.trouble

    def abandon(self, error: OSError) -> None:
        """Leave the file in its present state; messages that arrive later are counted as
        refused."""
        self._tables.close()
        self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self._sync.stop()
        self.trouble = f"the record cannot be written: {error}"
        self._log_error(self.trouble)
        try:
            self.file.abandon()
        except OSError as again:
            self._log_error(str(again))

    def _log_error(self, text: str) -> None:
        log.error("%s: %s", self.job, text, extra={"job": self.job})
