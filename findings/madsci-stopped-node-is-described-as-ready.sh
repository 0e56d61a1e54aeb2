#!/usr/bin/env bash
# A stopped node of MADSci is not ready, and its description says that it is.
#
# One would expect: `NodeStatus.description` names each state that makes `NodeStatus.ready` false.
# What happens: it names paused, locked, errored, disconnected and initializing, but not stopped. A stopped
# node reports `ready: false` with the description "Node is ready", which is what dashboards show.
# Seen with madsci.common 0.8.1 (PyPI), pydantic 2.14.4, Python 3.11.7. A node that stops, for example after
# an emergency stop, has to state the reason in a field of its own.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet madsci.common==0.8.1
"$folder/venv/bin/python" - <<'PYTHON'
from madsci.common.types.node_types import NodeStatus

descriptions = {}
for state in ("paused", "locked", "errored", "disconnected", "initializing", "stopped"):
    status = NodeStatus(**{state: True})
    assert not status.ready, state
    descriptions[state] = status.description
    print(f"{state}: ready = {status.ready}, description = {status.description!r}")
assert all("ready" not in text for state, text in descriptions.items() if state != "stopped"), descriptions
assert descriptions["stopped"] == "Node is ready", "the finding is out of date"
print("as described")
PYTHON
