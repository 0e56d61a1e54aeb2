#!/usr/bin/env bash
# A complete queryable on a wildcard takes every query away from the program that answers a key.
#
# One would expect: a query on `rig/actuator/trip` reaches the queryable that is declared on exactly
# this key, whoever else declares one on `rig/**`.
# What happens: by default (`QueryTarget.BEST_MATCHING`) Zenoh asks one complete queryable if there is
# any, such as a last-value store. The queryable on the exact key is not complete by default, and is
# not called. The asker gets the store's reply, or none at all where the store has no value. With
# `QueryTarget.ALL` both are asked.
# Seen with eclipse-zenoh 1.10.2 (PyPI), Python 3.11.7, all three sessions clients of one router:
#   replies by default:            []
#   replies with QueryTarget.ALL:  [b'done']
# A request to a program therefore needs `QueryTarget.ALL`, or a queryable declared as complete.
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

KEY = "rig/actuator/trip"
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


def act(query):
    """Reply as the program that owns the key."""
    with query:
        query.reply(KEY, b"done")


def remember(query):
    """Reply as a store that has no value for the key."""
    query.drop()


def replies(session, **how):
    """Return the payloads of all replies to a query."""
    found = session.get(KEY, payload=b"now", timeout=2.0, **how)
    return [reply.ok.payload.to_bytes() for reply in found if reply.ok is not None]


with opened("router", [place]), opened("client", (), [place]) as program:
    with opened("client", (), [place]) as store, opened("client", (), [place]) as asker:
        program.declare_queryable(KEY, act)
        time.sleep(0.5)
        assert replies(asker) == [b"done"], "the program does not reply even without a store"
        store.declare_queryable("rig/**", remember, complete=True)
        time.sleep(0.5)
        by_default, of_all = replies(asker), replies(asker, target=zenoh.QueryTarget.ALL)
print("replies by default:           ", by_default)
print("replies with QueryTarget.ALL: ", of_all)
assert of_all == [b"done"]
assert by_default == [], "the program is asked by default: the finding is out of date"
print("as described: the complete queryable takes the query, and the program is not asked")
PYTHON
