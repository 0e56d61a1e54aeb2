#!/usr/bin/env bash
# Of two replies on a key Zenoh keeps an old one with a timestamp, and drops a newer one without.
#
# One would expect: the default consolidation keeps the newest reply, or the one that arrives last.
# What happens: a reply with a timestamp is always kept, and one without is always dropped, however old
# the timestamp is. Clients and peers do not stamp their replies by default, and stores keep stamps, so
# the value of a store hides the present value of the program that owns the key.
# Seen with eclipse-zenoh 1.10.2 (PyPI), Python 3.11.7:
#   default consolidation: [b'a year ago'] in 10 of 10 queries
#   without consolidation: [b'a year ago', b'now']
# A query that wants the present value needs `ConsolidationMode.NONE` and a rule of its own.
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

KEY = "rig/position"
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


def replies(session, **how):
    """Return the payloads of all replies to a query that asks every queryable."""
    found = session.get(KEY, target=zenoh.QueryTarget.ALL, timeout=2.0, **how)
    return sorted(reply.ok.payload.to_bytes() for reply in found if reply.ok is not None)


with opened("router", [place]), opened("client", (), [place]) as program:
    with opened("client", (), [place]) as store, opened("client", (), [place]) as asker:
        now = store.new_timestamp()
        then = zenoh.Timestamp(time=now.get_time().replace(year=now.get_time().year - 1), id=now.get_id())

        def present(query):
            """Reply as the program does, which stamps nothing."""
            with query:
                query.reply(KEY, b"now")

        def past(query):
            """Reply as a store does, with the timestamp of a year ago."""
            with query:
                query.reply(KEY, b"a year ago", timestamp=then)

        program.declare_queryable(KEY, present)
        store.declare_queryable(KEY, past)
        time.sleep(0.5)
        kept = [replies(asker) for _ in range(10)]
        every = replies(asker, consolidation=zenoh.ConsolidationMode.NONE)
print("default consolidation:", kept[0], "in", kept.count([b"a year ago"]), "of 10 queries")
print("without consolidation:", every)
assert every == [b"a year ago", b"now"]
assert kept == [[b"a year ago"]] * 10, "the newer reply is kept: the finding is out of date"
print("as described: the old stamped reply hides the present one")
PYTHON
