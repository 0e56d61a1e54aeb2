"""Live record of a job: an MCAP file that stays readable however its writer ends."""

# Only the chunk that is being filled is buffered, and it is closed when it is full or old. So the
# data lost when the program is killed are limited in size and in time.

import errno
import json
import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import IndexType, Writer

from pincette import __version__
from pincette.core.messages import GroundTruth, JobNotice, Message
from pincette.core.topics import TOPIC_OF, TOPICS, Topic, key
from pincette.core.units import unit_of
from pincette.records import record_times
from pincette.records.columns import ARMS
from pincette.records.memory_file import MemoryFile
from pincette.records.record_times import LAST_NS, sample_0_ns, utc_text

NAME = "job.mcap"
PROFILE = "pincette"
ABOUT, TIMES, CLOSING = "record", "times", "closing"
"""Names of the metadata at the beginning of the file, at its first sample and at its end."""
CHUNK_BYTES = 65_536
CHUNK_NS = 250_000_000
INDEXED_CHUNKS = 20_000
"""Largest number of chunks of a file with an index; at four chunks a second they last 80 minutes.
"""
SEQUENCE_LIMIT = 2**32


class Unbuffered:
    """File whose writes reach the operating system before they return."""

    def __init__(self, path: Path, mode: str = "xb") -> None:
        self._path = path
        self._file: IO[bytes] = cast("IO[bytes]", path.open(mode, buffering=0))

    def write(self, data: bytes) -> int:
        """Write all bytes; raises OSError if the disk accepts fewer."""
        left = memoryview(data)
        while left:
            left = left[self._file.write(left) :]
        return len(data)

    def tell(self) -> int:
        """Return the position of the next byte."""
        return self._file.tell()

    def flush(self) -> None:
        """Do nothing, since nothing is buffered."""

    def sync(self) -> None:
        """Wait until the file is on the disk; raises OSError."""
        os.fsync(self._file.fileno())

    def require_in_place(self) -> None:
        """Raise OSError if the path of the file no longer leads to this open file."""
        own = os.fstat(self._file.fileno())
        try:
            found = self._path.stat()
        except FileNotFoundError:
            found = None
        if found is None or not os.path.samestat(own, found):
            text = "was removed, moved or replaced while it was written"
            raise OSError(errno.ESTALE, text, str(self._path))

    def duplicate(self) -> int:
        """Return another descriptor of the open file; the caller closes it."""
        return os.dup(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Chunks:
    """Writes chunks; omits the index of a file with more than ``INDEXED_CHUNKS`` of them.

    Readers then scan the file from its beginning.
    """

    # The library keeps the index of all chunks in memory until the end, 1 kB for each chunk. An
    # index of some chunks would make readers overlook the others.

    def __init__(self, stream: Unbuffered | MemoryFile) -> None:
        self.writer = Writer(cast("IO[bytes]", stream), chunk_size=CHUNK_BYTES)
        self.writer.start(PROFILE, f"pincette {__version__}")
        self._state = vars(self.writer)
        self._indexed = True

    def bound(self) -> None:
        """Drop the index if it is too long; call it after a chunk was closed."""
        index: list[Any] = self._state["_Writer__chunk_indices"]
        if self._indexed and len(index) <= INDEXED_CHUNKS:
            return
        self._indexed = False
        self._state["_Writer__index_types"] = IndexType.ATTACHMENT | IndexType.METADATA
        index.clear()

    def flush(self) -> None:
        """Close the chunk; raises OSError."""
        self.writer.flush()
        self.bound()


class McapFile:
    """Writes one record."""

    # A sample's log time is the arrival of sample 0 plus its number times the control period, so
    # that samples are evenly spaced in real time and in lockstep; its publish time is its arrival.
    # A message without a number of its own is logged at the newest sample's time. Before the first
    # sample, the start of the record takes the place of the arrival of sample 0.

    def __init__(
        self, path: Path, rig: str, *, about: Mapping[str, str], start_ns: int, period_s: float
    ) -> None:
        # Protocol Buffers take 5 MB, which a recorder without a job does not need.
        from pincette.records.schemas import SCHEMAS

        self._schemas = SCHEMAS
        self._stream = Unbuffered(path)
        self._chunks = Chunks(self._stream)
        self._writer = self._chunks.writer
        self._start_ns, self._period_ns = start_ns, round(period_s * 1e9)
        self._channels = {topic.name: self._register(rig, topic) for topic in TOPICS}
        self._sampled = False
        """True once a sample has arrived."""
        self._newest_ns = start_ns
        self._first_truth: int | None = None
        self._oldest_ns: int | None = None
        """Arrival of the oldest message in the chunk that is being filled, in ns."""
        self._bytes = 0
        self.chunks = 0
        """Number of chunks that were closed and passed to the operating system."""
        self.counts: Counter[str] = Counter()
        """Number of written messages, by topic."""
        self._begin = {record_times.BEGIN: utc_text(start_ns)}
        self._writer.add_metadata(ABOUT, {**about, **self._begin})

    def _register(self, rig: str, topic: Topic) -> int:
        schema = self._schemas[topic.name]
        number = self._writer.register_schema(schema.name, "protobuf", schema.descriptor)
        records = [topic.message, *([ARMS[topic.message]] if topic.message in ARMS else [])]
        names = [name for record in records for name in record.__struct_fields__]
        units = {name: unit_of(name) for name in names}
        metadata = {
            "key": key(rig, topic),
            "producer": topic.producer,
            "summary": topic.summary,
            "units": json.dumps({n: u for n, u in units.items() if u}, ensure_ascii=False),
        }
        return self._writer.register_channel(topic.name, "protobuf", number, metadata)

    def attach(self, name: str, media_type: str, content: bytes, at_ns: int) -> None:
        """Attach a whole file to the record; raises OSError."""
        self._writer.add_attachment(at_ns, at_ns, name, media_type, content)

    def add(self, message: Message, arrival_ns: int) -> None:
        """Write a message; raises OSError, or ValueError for a number beyond 64 bit."""
        name = TOPIC_OF[type(message)].name
        number = getattr(message, "seq", 0)
        payload = self._schemas[name].pack(message)
        if not self._sampled:
            self._place_sample_0(message, arrival_ns)
        self._writer.add_message(
            self._channels[name],
            log_time=self._log_ns(message),
            data=payload,
            publish_time=arrival_ns,
            sequence=max(0, number) % SEQUENCE_LIMIT,
        )
        self.counts[name] += 1
        self._bytes += len(payload)
        if self._oldest_ns is None:
            self._oldest_ns = arrival_ns
        if self._bytes >= CHUNK_BYTES:
            self.flush()

    def _place_sample_0(self, message: Message, arrival_ns: int) -> None:
        """Count log times from sample 0, and store its time, if the message is a sample."""
        found_ns = sample_0_ns(message, arrival_ns, self._period_ns)
        if found_ns is None:
            return
        self._sampled, self._start_ns = True, found_ns
        times = {**self._begin, record_times.SAMPLE_0: utc_text(found_ns)}
        self._writer.add_metadata(TIMES, times)

    def _log_ns(self, message: Message) -> int:
        if isinstance(message, JobNotice):
            return self._newest_ns
        number = cast(Any, message).seq
        if isinstance(message, GroundTruth):
            # A simulated rig counts its ticks from its own start.
            if self._first_truth is None:
                self._first_truth = number
            number -= self._first_truth
        time_ns = min(max(0, self._start_ns + number * self._period_ns), LAST_NS)
        if not isinstance(message, GroundTruth):
            self._newest_ns = max(self._newest_ns, time_ns)
        return time_ns

    def flush_aged(self, now_ns: int) -> None:
        """Close the chunk if its oldest message is a quarter of a second old."""
        if self._oldest_ns is not None and now_ns - self._oldest_ns >= CHUNK_NS:
            self.flush()

    def flush(self) -> None:
        """Close the chunk; raises OSError."""
        self._chunks.flush()
        self._oldest_ns, self._bytes = None, 0
        self.chunks += 1

    def sync(self) -> None:
        """Sync the file with the chunks that were flushed so far; raises OSError."""
        self._stream.sync()

    def duplicate(self) -> int:
        """Return another descriptor of the open file, which the caller closes; raises OSError."""
        return self._stream.duplicate()

    def finish(self, closing: Mapping[str, str]) -> None:
        """Write how the record ended and the summary, and close the file.

        Raises OSError, also if the file is not at its path any more.
        """
        self.flush()
        self._writer.add_metadata(CLOSING, dict(closing))
        self._writer.finish()
        self._stream.sync()
        self._stream.require_in_place()
        self._stream.close()

    def abandon(self) -> None:
        """Close the file in its present state, for a disk that accepts no more data."""
        self._stream.close()
