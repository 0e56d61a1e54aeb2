#!/usr/bin/env bash
# The Python writer of MCAP keeps an index entry of every chunk in memory, also without a chunk index.
#
# One would expect: `Writer(..., index_types=IndexType.NONE)`, which writes no index, needs memory that
# does not grow with the length of the recording.
# What happens: the file has no chunk index, but the writer still keeps one `ChunkIndex` for each chunk,
# with the offset of every channel in it, until `finish()`. A recording of weeks grows without a bound.
# Seen with mcap 1.6.0 (PyPI), Python 3.11.7. A recorder has to empty that list itself, or begin a new file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --no-deps mcap==1.6.0
"$folder/venv/bin/pip" install --quiet lz4 zstandard
"$folder/venv/bin/python" - "$folder" <<'PYTHON'
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

CHUNKS, CHANNELS = 2000, 4


def recorded(index_types):
    """Write one small chunk after the other; return the file and the entries kept before finish."""
    path = Path(sys.argv[1]) / f"{index_types.value}.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=256, compression=CompressionType.NONE, index_types=index_types)
        writer.start()
        channels = [writer.register_channel(f"/c{n}", "raw", 0) for n in range(CHANNELS)]
        for tick in range(CHUNKS):
            for channel in channels:
                writer.add_message(channel, tick, b"x" * 64, tick)
        kept = len(writer._Writer__chunk_indices)
        writer.finish()
    with path.open("rb") as stream:
        return kept, len(make_reader(stream).get_summary().chunk_indexes)


with_index, without = recorded(IndexType.ALL), recorded(IndexType.NONE)
print("entries in memory and in the file, with all indexes:", *with_index)
print("entries in memory and in the file, with no index:   ", *without)
assert with_index[0] == with_index[1] >= CHUNKS // 2, with_index
assert without[1] == 0, "the file has a chunk index although none was asked for"
assert without[0] == with_index[0], "the writer no longer keeps the entries: the finding is out of date"
print("as described: the option changes the file, not the memory")
PYTHON
