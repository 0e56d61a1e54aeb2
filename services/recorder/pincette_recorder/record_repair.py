"""Closes records whose writer was killed, or whose disk was full."""

import json
import logging
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import mcap.records as mcap

from pincette.core.topics import POSITION
from pincette.records import folder as files
from pincette.records import mcap_reading, record_times
from pincette.records.mcap_file import CLOSING, NAME, SEQUENCE_LIMIT, Chunks, Unbuffered
from pincette.records.tables import Written, write_tables_of_file

log = logging.getLogger(__name__)
BOUNDED = 10_000
"""Messages after which the index of a copy is bounded."""
KILLED = "the recorder ended while this was being recorded"


def unclosed(records: Path) -> Iterator[Path]:
    """Folders of jobs whose record has no end, the oldest first; raises OSError."""
    for path in sorted(records.glob(f"*/{NAME}")):
        if not mcap_reading.is_closed(path):
            yield path.parent


def mend(folder: Path, why: str) -> dict[str, str]:
    """Close a record that broke off, with tables and manifest; returns its end; raises OSError."""
    path = folder / NAME
    try:
        written = write_tables_of_file(folder)
    except ValueError as error:  # of another version; the file itself can be closed all the same
        written = Written([f"no table: {error}"], {}, {})
    why = _manifest(folder).get("detail") or why
    closing = repair(
        path,
        {
            "dropped": str(sum(written.missing.values())),
            "complete": "false",
            "detail": "; ".join([why, *written.wrong]),
            **written.times,
        },
    )
    about = mcap_reading.read_closing(path)[0] | written.times
    write_manifest(folder, about, closing)
    log.info("%s: closed with %s messages: %s", folder.name, closing["messages"], why)
    return closing


def write_manifest(folder: Path, about: Mapping[str, str], closing: Mapping[str, str]) -> None:
    """Write a manifest that keeps what the supervisor has written in its own; raises OSError."""
    kept: dict[str, Any] = {name: text for name, text in about.items() if name != "request"}
    kept |= _manifest(folder)
    kept |= {name: about[name] for name in record_times.NAMES if name in about}
    kept.pop("files", None)
    complete = closing["complete"] == "true"
    files.write_manifest(folder, {**kept, "complete": complete, "detail": closing["detail"]})


def _manifest(folder: Path) -> dict[str, Any]:
    """The manifest; empty where there is none that can be read."""
    with suppress(OSError, ValueError):
        tree: Any = json.loads((folder / files.MANIFEST).read_text(encoding="utf-8"))
        if isinstance(tree, dict):
            return cast("dict[str, Any]", tree)
    return {}


def repair(path: Path, closing: Mapping[str, str]) -> dict[str, str]:
    """Close a record that broke off, and return its closing; raises OSError.

    The closing also has the number of messages, and the numbers of the first and the last sample.
    """
    # The file is replaced only once the copy of it is complete and on the disk.
    draft = path.with_name(path.name + ".part")
    stream = Unbuffered(draft, "wb")
    try:
        written = _copy(path, stream, closing)
        stream.sync()
    except BaseException:
        stream.close()
        draft.unlink(missing_ok=True)
        raise
    stream.close()
    draft.replace(path)
    return written


def _copy(path: Path, stream: Unbuffered, closing: Mapping[str, str]) -> dict[str, str]:
    chunks = Chunks(stream)
    writer = chunks.writer
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    samples: set[int] = set()
    """Channels of the topic of which each sample has one."""
    kept, first, last = 0, SEQUENCE_LIMIT, -1
    for entry in mcap_reading.entries(path):
        match entry:
            case mcap.Schema() if entry.id not in schemas:
                number = writer.register_schema(entry.name, entry.encoding, entry.data)
                schemas[entry.id] = number
            case mcap.Channel() if entry.id not in channels:
                if entry.topic == POSITION.name:
                    samples.add(entry.id)
                channels[entry.id] = writer.register_channel(
                    entry.topic, entry.message_encoding, schemas[entry.schema_id], entry.metadata
                )
            case mcap.Message():
                writer.add_message(
                    channels[entry.channel_id],
                    entry.log_time,
                    entry.data,
                    entry.publish_time,
                    entry.sequence,
                )
                kept += 1
                if entry.channel_id in samples:
                    first, last = min(first, entry.sequence), max(last, entry.sequence)
                if kept % BOUNDED == 0:
                    chunks.bound()
            case mcap.Metadata() if entry.name != CLOSING:
                writer.add_metadata(entry.name, entry.metadata)
            case mcap.Attachment():
                writer.add_attachment(
                    entry.create_time, entry.log_time, entry.name, entry.media_type, entry.data
                )
            case _:
                pass
    chunks.flush()
    written = {**closing, "messages": str(kept)}
    if last >= 0:
        detail = f"{closing.get('detail', '')}; samples {first} to {last} are recorded"
        written |= {"first_seq": str(first), "last_seq": str(last), "detail": detail}
    writer.add_metadata(CLOSING, written)
    writer.finish()
    return written
