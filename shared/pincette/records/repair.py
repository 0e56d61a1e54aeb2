"""A record that nobody has closed, copied into one that has its end."""

from collections.abc import Mapping
from pathlib import Path
from typing import IO, cast

import mcap.records as mcap
from mcap.writer import Writer

from pincette import __version__
from pincette.records.mcap_file import CHUNK_BYTES, CLOSING, PROFILE, Unbuffered
from pincette.records.mcap_reading import entries


def repair(path: Path, closing: Mapping[str, str]) -> int:
    """Close a record that broke off; returns how many messages could be kept.

    The file is replaced only once the copy of it is complete and on the disk.

    Raises
    ------
    OSError
        Where it cannot be read, or the copy not be written.
    """
    draft = path.with_name(path.name + ".part")
    stream = Unbuffered(draft, "wb")
    try:
        kept = _copy(path, stream, closing)
        stream.sync()
    except BaseException:
        stream.close()
        draft.unlink(missing_ok=True)
        raise
    stream.close()
    draft.replace(path)
    return kept


def _copy(path: Path, stream: Unbuffered, closing: Mapping[str, str]) -> int:
    writer = Writer(cast("IO[bytes]", stream), chunk_size=CHUNK_BYTES)
    writer.start(PROFILE, f"pincette {__version__}")
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    kept = 0
    for entry in entries(path):
        match entry:
            case mcap.Schema() if entry.id not in schemas:
                number = writer.register_schema(entry.name, entry.encoding, entry.data)
                schemas[entry.id] = number
            case mcap.Channel() if entry.id not in channels:
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
            case mcap.Metadata() if entry.name != CLOSING:
                writer.add_metadata(entry.name, entry.metadata)
            case mcap.Attachment():
                writer.add_attachment(
                    entry.create_time, entry.log_time, entry.name, entry.media_type, entry.data
                )
            case _:
                pass
    writer.add_metadata(CLOSING, {**closing, "messages": str(kept)})
    writer.finish()
    return kept
