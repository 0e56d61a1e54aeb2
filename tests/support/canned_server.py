"""The REST server of a canned rig in a process of its own.

The application and the server are built as the supervisor builds them; the rig behind them answers
at once. ``python -m tests.support.canned_server DATA PKI KEYS`` prints one line of JSON with the
address, the keys and a job, and ends when standard input closes. PKI is a folder of certificates,
or empty for plain HTTP; KEYS is 1 where keys are wanted.
"""

import json
import subprocess
import sys
from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from pincette.engine.realtime.gc_tuning import freeze_gc
from pincette.security.folder import Folder
from pincette.security.identity import SUPERVISOR, program
from pincette_supervisor.access.access import Access, KeySync, TokenBuckets
from pincette_supervisor.access.authentication import digest_of, new_key
from pincette_supervisor.journal.key_file import KeyFile
from pincette_supervisor.rest.tls import server_context
from tests.support.apps import create_app
from tests.support.rigs import demo_rig
from tests.support.served import served
from tests.unit.supervisor.harness import Harness

PLAYED = 200
"""Tick of the canned grip at which the job waits; a part is held then."""


@dataclass(frozen=True)
class CannedServer:
    """A server that runs, as its clients see it."""

    api: str
    job: str
    """A job that runs until it is stopped."""
    key: str
    """Key of an honest client; empty where none is wanted."""
    hostile_key: str


def serve(data: Path, pki: str, *, keys: bool) -> None:
    """Serve until standard input closes."""
    harness = Harness(demo_rig(time="lockstep"), data)
    job = harness.playing_to(PLAYED)
    access = Access(buckets=TokenBuckets())
    shown = {"honest": "", "hostile": ""}
    if keys:
        file = KeyFile(harness.store.folder)
        for name in shown:
            shown[name] = new_key()
            file.add(name, digest_of(shown[name]), "operate")
    tls = server_context(Folder(Path(pki)).credentials(program(SUPERVISOR, ""))) if pki else None
    with (
        closing(harness),
        closing(KeySync(harness.store, access)),
        served(create_app(harness.rigs, access), tls=tls) as address,
    ):
        freeze_gc()
        told = CannedServer(f"{address}/api/v1/", job, shown["honest"], shown["hostile"])
        print(json.dumps(asdict(told)), flush=True)
        sys.stdin.read()


@contextmanager
def canned_server(
    data: Path, pki: Path | None = None, *, keys: bool = True
) -> Generator[CannedServer]:
    """Run a server in a process of its own as long as the block lasts."""
    words = [sys.executable, "-m", __name__, str(data), str(pki or ""), str(int(keys))]
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield CannedServer(**json.loads(process.stdout.readline()))
    finally:
        process.stdin.close()
        process.wait(60.0)


if __name__ == "__main__":
    serve(Path(sys.argv[1]), sys.argv[2], keys=sys.argv[3] == "1")
