#!/usr/bin/env bash
# Rerun converts an MCAP file that is still being written to an empty recording, with exit status 0.
#
# One would expect: `rerun mcap convert` shows the messages of all chunks that are in the file, as the stream readers
# of the format do, or ends with an error status. The summary, which the writer adds at its end, is optional.
# What happens: it logs that it failed to load the file, writes a recording without a message, and ends with exit status
# 0, so that a script goes on with the empty recording. The same file with its end has all messages.
# Seen with rerun-sdk 0.41.0 and mcap 1.6.0 (PyPI), Python 3.11.7. Write a finished copy first (`mcap recover`).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0 rerun-sdk==0.41.0
export HOME=$folder XDG_CONFIG_HOME=$folder
"$folder/venv/bin/python" - "$folder" <<'PYTHON'
import json
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

folder = Path(sys.argv[1])
rerun = folder / "venv/bin/rerun"
SCHEMA = {"type": "object", "properties": {"x": {"type": "number"}}}


def rows(path):
    """Return how many messages a stream reader and the converted recording have, and the status."""
    read = 0
    with path.open("rb") as file, suppress(EndOfFile):
        for one in StreamReader(file).records:
            read += isinstance(one, Message)
    target = path.with_suffix(".rrd")
    done = subprocess.run(
        [rerun, "mcap", "convert", path, "--output", target], capture_output=True, text=True
    )
    shown = subprocess.run([rerun, "rrd", "print", "-vvv", target], capture_output=True, text=True)
    failed = "Failed to load" in done.stderr
    print(f"{path.name}: {read} messages; convert: status {done.returncode}, failure logged: {failed}")
    return read, done.returncode, shown.stdout.count("/c"), shown.stdout


with (folder / "whole.mcap").open("wb") as file:
    writer = Writer(file)
    writer.start()
    schema = writer.register_schema("S", "jsonschema", json.dumps(SCHEMA).encode())
    channel = writer.register_channel("/c", "json", schema)
    for tick in range(10):
        writer.add_message(channel, tick, b'{"x": %d}' % tick, tick)
    writer.flush()
    file.flush()
    (folder / "open.mcap").write_bytes((folder / "whole.mcap").read_bytes())
    writer.finish()
whole, begun = (rows(folder / name) for name in ("whole.mcap", "open.mcap"))
assert whole[0] == begun[0] == 10, (whole, begun)
assert whole[1] == 0 and whole[2], whole
assert begun[1] == 0 and not begun[2], "it fails or shows messages now: the finding is out of date"
print("as described: an empty recording, and exit status 0")
PYTHON
