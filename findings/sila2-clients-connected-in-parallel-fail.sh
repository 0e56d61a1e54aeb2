#!/usr/bin/env bash
# Two SiLA clients that are built at the same time in two threads fail, although they share nothing.
#
# One would expect: an orchestrator connects to its devices in parallel, with one `SilaClient` per
# device and thread, as with any other gRPC client.
# What happens: `SilaClient` compiles each feature of its server with protoc, imports the result as
# a module whose name is the feature's identifier, and deletes it from `sys.modules`. All servers
# have the feature `SiLAService`, so two threads import and delete modules of one name. About one
# connection in ten ends with `KeyError: 'SiLAService_pb2'` or `'SiLAService_pb2_grpc'`.
# Seen with sila2 0.14.0, grpcio 1.85.3, grpcio-tools 1.85.1, protobuf 7.36.2 (PyPI), Python 3.11.7:
#   one after another: 40 connected
#   four at once:      36 connected, 2 KeyError 'SiLAService_pb2_grpc', 2 KeyError 'SiLAService_pb2'
# Hold a lock while a client is built; built clients may be used in parallel.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet sila2==0.14.0 grpcio==1.85.3 grpcio-tools==1.85.1 protobuf==7.36.2
"$folder/venv/bin/python" - <<'PYTHON'
import logging
import socket
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from threading import Lock

from sila2.client import SilaClient
from sila2.server import SilaServer

DEVICES, MOST_ROUNDS = 4, 60
logging.disable(logging.WARNING)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


ports = [free_port() for _ in range(DEVICES)]
servers = [SilaServer("device", "Example", "An empty server", "1.0", "https://example.org") for _ in ports]
for server, port in zip(servers, ports):
    server.start_insecure("127.0.0.1", port, enable_discovery=False)


def connected(rounds, turn, until_error=False):
    """Connect to all devices at once, round after round; count how the connections end."""

    def connect(port):
        try:
            with turn:
                SilaClient("127.0.0.1", port, insecure=True)
        except Exception as error:
            return f"{type(error).__name__}: {error}"
        return "connected"

    ends = Counter()
    with ThreadPoolExecutor(DEVICES) as pool:
        for _ in range(rounds):
            ends.update(pool.map(connect, ports))
            if until_error and len(ends) > 1:
                break
    return ends


in_turn = connected(5, Lock())
print("with a lock:   ", dict(in_turn))
at_once = connected(MOST_ROUNDS, nullcontext(), until_error=True)
print("without a lock:", dict(at_once))
assert set(in_turn) == {"connected"}, in_turn
assert any(end.startswith("KeyError") for end in at_once), "the finding is out of date"
for server in servers:
    server.stop()
print("as described")
PYTHON
