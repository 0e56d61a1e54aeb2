#!/usr/bin/env bash
# The Python reader of MCAP reports a torn chunk by errors that are no McapError.
#
# One would expect: a file whose last chunk a power cut has torn ends with `EndOfFile` or another
# `McapError`, so that a program that recovers such files catches one class.
# What happens: by what lies where the chunk breaks off, reading ends with `UnicodeDecodeError`,
# `struct.error`, `ZstdError` or `CRCValidationError`, which is a `ValueError`. A recovery that catches `McapError` alone ends with a traceback.
# Seen with mcap 1.6.0 (PyPI), Python 3.11.7. Catch all of these classes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --no-deps mcap==1.6.0
"$folder/venv/bin/pip" install --quiet lz4 zstandard
"$folder/venv/bin/python" - <<'PYTHON'
import io
from collections import Counter

from mcap.exceptions import McapError
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

stream = io.BytesIO()
writer = Writer(stream, chunk_size=10**6)
writer.start()
channel = writer.register_channel("/c", "raw", 0)
for tick in range(50):
    writer.add_message(channel, tick, bytes(tick), tick)
writer.flush()
begin = len(stream.getvalue())
for tick in range(50):
    writer.add_message(channel, tick, bytes(tick), tick)
writer.flush()
content = stream.getvalue()
ends = Counter()
for cut in range(begin + 1, len(content), 3):
    for garbage in (b"", bytes(10_000), bytes(range(256)) * 64):
        try:
            records = StreamReader(io.BytesIO(content[:cut] + garbage), validate_crcs=True).records
            for _ in records:
                pass
            ends["no error"] += 1
        except Exception as error:
            kind = f"{type(error).__module__}.{type(error).__name__}"
            ends[f"McapError: {kind}" if isinstance(error, McapError) else kind] += 1
for name, count in ends.most_common():
    print(f"{count:5} times {name}")
others = [name for name in ends if not name.startswith("McapError") and name != "no error"]
assert others, "every end is a McapError now: the finding is out of date"
print("as described: also", ", ".join(others))
PYTHON
