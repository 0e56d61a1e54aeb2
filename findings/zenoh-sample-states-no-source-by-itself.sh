#!/usr/bin/env bash
# A sample of Zenoh does not say which publisher sent it, and no publisher counts its samples.
#
# One would expect: `Sample.source_info` of a sample from a declared publisher has the id of this publisher,
# and a sequence number that rises by one with each sample, so that a subscriber can tell two publishers of
# a key apart and see what was lost.
# What happens: `source_info` is None, for `Publisher.put` as for `Session.put`. Only what the sender passes
# as `source_info` with each sample arrives, the number as it was passed.
# Seen with eclipse-zenoh 1.10.2 (PyPI), Python 3.11.7, a subscriber in a peer and a client linked to it:
#   Session.put:                       None
#   Publisher.put:                     None
#   Publisher.put with source_info 7:  number 7, session of the publisher: True
#   Publisher.put with source_info 7:  number 7, session of the publisher: True
# Programs that have to be told apart pass `SourceInfo(publisher.id, number)` with every sample.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import json
import socket
import time

import zenoh

with socket.create_server(("127.0.0.1", 0)) as probe:
    place = f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def opened(mode, listen=(), connect=()):
    """Open a session with explicit links and without discovery."""
    tree = {
        "mode": mode,
        "listen": {"endpoints": list(listen)},
        "connect": {"endpoints": list(connect)},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(tree)))


heard = []
with opened("peer", [place]) as listener, opened("client", (), [place]) as sender:
    subscriber = listener.declare_subscriber("arm/x", heard.append)
    publisher = sender.declare_publisher("arm/x")
    time.sleep(0.5)
    sender.put("arm/x", b"")
    publisher.put(b"")
    for _ in range(2):
        publisher.put(b"", source_info=zenoh.SourceInfo(publisher.id, 7))
    time.sleep(0.5)
    session = str(sender.info.zid())
ways = ("Session.put", "Publisher.put", *("Publisher.put with source_info 7",) * 2)
assert len(heard) == len(ways), heard
for way, sample in zip(ways, heard):
    info = sample.source_info
    stated = None
    if info is not None:
        stated = f"number {info.source_sn}, session of the publisher: {str(info.source_id.zid) == session}"
    print(f"{way + ':':34} {stated}")
assert [sample.source_info for sample in heard[:2]] == [None, None], "the finding is out of date"
assert [sample.source_info.source_sn for sample in heard[2:]] == [7, 7], "the finding is out of date"
print("as described: a sample states its source only where the sender passes it")
PYTHON
