#!/usr/bin/env bash
# A liveliness token may be a wildcard, and every lookup of other tokens then returns it.
#
# One would expect: a liveliness token names one thing that is alive, so that a lookup of `rig/live/*`
# returns keys of three parts, of which the last one is a name.
# What happens: `declare_token` accepts any key expression. A token on `rig/**` or `**` is returned by
# each lookup and delivered to each liveliness subscriber whose key expression it intersects, with its
# own key expression in place of a key. Code that takes the name from the key fails with it.
# Seen with eclipse-zenoh 1.10.2 (PyPI), Python 3.11.7, all sessions clients of one router:
#   a lookup of rig/live/*:      ['**', 'rig/**', 'rig/live/arm']
#   a subscriber on rig/live/*:  ['**', 'rig/**', 'rig/live/arm']
# A program that parses tokens must ignore those that are not of its own form.
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

WANTED = "rig/live/*"
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
with opened("router", [place]), opened("client", (), [place]) as program:
    with opened("client", (), [place]) as tool, opened("client", (), [place]) as asker:
        own = program.liveliness().declare_token("rig/live/arm")
        others = [tool.liveliness().declare_token(key) for key in ("rig/**", "**")]
        time.sleep(0.5)
        replies = asker.liveliness().get(WANTED, timeout=2.0)
        found = sorted(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)
        subscriber = asker.liveliness().declare_subscriber(
            WANTED, lambda sample: heard.append(str(sample.key_expr)), history=True
        )
        time.sleep(0.5)
        subscriber.undeclare()
print(f"a lookup of {WANTED}:     ", found)
print(f"a subscriber on {WANTED}: ", sorted(heard))
assert "rig/live/arm" in found
assert found == sorted(heard)
assert found != ["rig/live/arm"], "no wildcard is returned: the finding is out of date"
print("as described: tokens with wildcards are returned beside those of programs")
PYTHON
