"""Reader of records, including the readable part of one whose writer was killed."""

import struct
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mcap.records as mcap
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import MAGIC_SIZE, StreamReader
from zstandard import ZstdError

from pincette.core.messages import Message
from pincette.core.topics import TOPICS
from pincette.records.mcap_file import ABOUT, CLOSING

MAGIC = b"\x89MCAP0\r\n"
NAMES = frozenset(topic.name for topic in TOPICS)
LONGEST_BYTES = 256 * 2**20
"""Length in bytes above which a record of the file format counts as damaged."""
BROKEN = (McapError, ZstdError, struct.error, ValueError)


@dataclass(frozen=True, slots=True)
class Recording:
    """Content of a record."""

    about: dict[str, str]
    """Metadata of the record; see ``results.archive.about``."""
    closing: dict[str, str] | None
    """Metadata that states how the record ended; None if it is not closed."""
    messages: list[Message] = field(repr=False)
    """Messages in order of arrival."""
    attachments: dict[str, bytes] = field(default_factory=dict[str, bytes], repr=False)

    @property
    def period_s(self) -> float:
        """Return the control period in s; raises KeyError if the record lacks it."""
        return float(self.about["period_s"])


def is_closed(path: Path) -> bool:
    """Return whether a record has its end, by the last bytes of the file; raises OSError."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if size < 2 * MAGIC_SIZE:
            return False
        file.seek(size - MAGIC_SIZE)
        return file.read() == MAGIC


def entries(path: Path) -> Iterator[mcap.McapRecord]:
    """Yield all entries in order, up to the end or to the first damage; raises OSError."""
    with path.open("rb") as file:
        reader = StreamReader(file, validate_crcs=True, record_size_limit=LONGEST_BYTES)
        try:
            yield from reader.records
        except BROKEN:
            return  # the rest was not written completely


def read(path: Path) -> Recording:
    """Read a whole record; raises OSError, or ValueError for messages of another version."""
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    messages: list[Message] = []
    decoder = Decoder()
    for entry in entries(path):
        match entry:
            case mcap.Metadata():
                metadata[entry.name] = entry.metadata
            case mcap.Attachment():
                attachments[entry.name] = entry.data
            case _:
                messages.extend(decoder.decode(entry))
    return Recording(metadata.get(ABOUT, {}), metadata.get(CLOSING), messages, attachments)


def messages_of(path: Path, topics: Collection[str] = NAMES) -> Iterator[Message]:
    """Read the messages of some topics one by one; raises as ``read`` does."""
    return (message for message, _ in arrivals_of(path, topics))


def arrivals_of(path: Path, topics: Collection[str] = NAMES) -> Iterator[tuple[Message, int]]:
    """Read the messages of some topics, each with its arrival in ns of UTC; raises as ``read``."""
    decoder = Decoder(topics)
    for entry in entries(path):
        arrival_ns = entry.publish_time if isinstance(entry, mcap.Message) else 0
        for message in decoder.decode(entry):
            yield message, arrival_ns


class Decoder:
    """Decodes the messages of a file by the schemas that the file holds."""

    def __init__(self, topics: Collection[str] = NAMES) -> None:
        self._topics = topics
        self._schemas: dict[int, bytes] = {}
        self._readers: dict[int, Callable[[bytes], Any]] = {}

    def decode(self, entry: mcap.McapRecord) -> Iterator[Message]:
        """Decode an entry if it is a message on one of the topics; raises ValueError."""
        match entry:
            case mcap.Schema():
                self._schemas[entry.id] = entry.data
            case mcap.Channel() if entry.topic in self._topics and entry.topic in NAMES:
                # Protocol Buffers are imported when the first record is read.
                from pincette.records.schemas import unpacker

                self._readers[entry.id] = unpacker(entry.topic, self._schemas[entry.schema_id])
            case mcap.Message() if entry.channel_id in self._readers:
                yield self._readers[entry.channel_id](entry.data)
            case _:
                pass


def read_about(path: Path) -> dict[str, str]:
    """Read the metadata at the beginning of a record; raises OSError."""
    for entry in entries(path):
        if isinstance(entry, mcap.Metadata):
            return entry.metadata
    return {}


def read_closing(path: Path) -> tuple[dict[str, str], dict[str, str] | None]:
    """Read the metadata at the start and at the end of a record, without samples.

    Raises OSError.
    """
    found: list[mcap.Metadata] = []
    if is_closed(path):
        with path.open("rb") as file, suppress(*BROKEN):
            found = [*make_reader(file).iter_metadata()]
    if not found:
        found = [entry for entry in entries(path) if isinstance(entry, mcap.Metadata)]
    metadata = {entry.name: entry.metadata for entry in found}
    return metadata.get(ABOUT, {}), metadata.get(CLOSING)
