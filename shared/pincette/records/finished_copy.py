"""Finished copy of a record that is still being written or whose writer was interrupted."""

from collections.abc import Generator, Iterator, Mapping
from pathlib import Path
from typing import IO

import mcap.records as mcap

from pincette.core.topics import POSITION
from pincette.records import mcap_reading, record_times
from pincette.records.mcap_file import CLOSING, SEQUENCE_LIMIT, Chunks
from pincette.records.memory_file import MemoryFile

NAME = "snapshot.mcap"
"""File name of a copy that is made during its download."""
AT_ONCE = 1_000
"""Number of messages in a part; the index of the copy is bounded after each part."""
READ_BYTES = 2**18
UNFINISHED = "copied from an unfinished record, which is still being written or was interrupted"


def snapshot(path: Path) -> Iterator[bytes]:
    """Yield the parts of a file that every reader can open, from a record in any state.

    A finished record is copied unchanged. Raises OSError before the first part.
    """
    if mcap_reading.is_closed(path):
        return _parts(path.open("rb"))
    return iter(FinishedCopy(path, {"complete": "false", "detail": UNFINISHED}))


def _parts(file: IO[bytes]) -> Iterator[bytes]:
    with file:
        while part := file.read(READ_BYTES):
            yield part


class FinishedCopy:
    """Parts of a copy that has its end and its index."""

    def __init__(self, path: Path, closing: Mapping[str, str]) -> None:
        """Prepare a copy; ``closing`` is the metadata about the end of the record."""
        self._path = path
        self.closing = dict(closing)
        """Metadata at the end of the record. After the last part it also contains the number of
        messages, the numbers of the first and the last sample, and the times of the record."""

    def __iter__(self) -> Generator[bytes]:
        """Yield the parts; raises OSError."""
        file = MemoryFile()
        chunks = Chunks(file)
        writer = chunks.writer
        schemas: dict[int, int] = {0: 0}
        channels: dict[int, int] = {}
        samples: set[int] = set()
        """Channels of the topic that has one message for each sample."""
        times: dict[str, str] = {}
        kept, first, last, end_ns = 0, SEQUENCE_LIMIT, -1, 0
        for entry in mcap_reading.entries(self._path):
            match entry:
                case mcap.Schema() if entry.id not in schemas:
                    number = writer.register_schema(entry.name, entry.encoding, entry.data)
                    schemas[entry.id] = number
                case mcap.Channel() if entry.id not in channels:
                    if entry.topic == POSITION.name:
                        samples.add(entry.id)
                    channels[entry.id] = writer.register_channel(
                        entry.topic,
                        entry.message_encoding,
                        schemas[entry.schema_id],
                        entry.metadata,
                    )
                case mcap.Message():
                    writer.add_message(
                        channels[entry.channel_id],
                        entry.log_time,
                        entry.data,
                        entry.publish_time,
                        entry.sequence,
                    )
                    kept, end_ns = kept + 1, max(end_ns, entry.publish_time)
                    if entry.channel_id in samples:
                        first, last = min(first, entry.sequence), max(last, entry.sequence)
                    if kept % AT_ONCE == 0:
                        chunks.bound()
                        yield file.take()
                case mcap.Metadata() if entry.name != CLOSING:
                    writer.add_metadata(entry.name, entry.metadata)
                    times |= {n: t for n, t in entry.metadata.items() if n in record_times.NAMES}
                case mcap.Attachment():
                    writer.add_attachment(
                        entry.create_time, entry.log_time, entry.name, entry.media_type, entry.data
                    )
                case _:
                    pass
        chunks.flush()
        if kept:
            times[record_times.END] = record_times.utc_text(end_ns)
        closing = {**times, **self.closing, "messages": str(kept)}
        if last >= 0:
            detail = f"{closing.get('detail', '')}; samples {first} to {last} are recorded"
            closing |= {"first_seq": str(first), "last_seq": str(last), "detail": detail}
        self.closing = closing
        writer.add_metadata(CLOSING, closing)
        writer.finish()
        yield file.take()
