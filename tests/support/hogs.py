"""Programs that keep a machine busy or flood the bus.

Each is a separate program, ``python -m tests.support.hogs WHAT …``, that runs until standard input
closes: ``cpu`` keeps a processor busy, ``disk FOLDER`` writes and waits for the disk, ``flood
ENDPOINT RIG RATE_HZ`` puts garbage and forged commands on the key of the controller. The last is a
plain Zenoh program that uses nothing of pincette, and reports at the end what it has sent.
"""

# Zenoh's and MessagePack's stubs leave types open.
# pyright: reportUnknownMemberType=false

import json
import os
import random
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any, cast

import msgpack as untyped_msgpack
import zenoh

msgpack = cast(Any, untyped_msgpack)
Json = dict[str, Any]
SEED = 20132
BLOCK = 1 << 20
BLOCKS = 64
"""Number of blocks of one mebibyte, after which the disk writer begins at the front again."""
HUGE = 100_000
"""Size in bytes above that of every message that the bus accepts."""
STOP_S = 10.0
NONSENSE = float("nan")
KINDS = (
    "garbage",
    "truncated",
    "huge",
    "not a number",
    "absurd",
    "foreign owner",
    "old epoch",
    "replay",
)


@contextmanager
def hog(*words: str | Path) -> Generator[Json]:
    """Run one of the programs for the duration of the block; then its output is available."""
    command = [sys.executable, "-m", "tests.support.hogs", *map(str, words)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    reported: Json = {}
    try:
        yield reported
    finally:
        try:
            output, _ = process.communicate(timeout=STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise
    if output:
        reported.update(cast(Json, json.loads(output)))


def burn(end: threading.Event) -> None:
    """Keep a processor busy."""
    while not end.is_set():
        sum(range(10_000))


def write(end: threading.Event, folder: Path) -> None:
    """Write to the disk, and wait for it."""
    block = random.Random(SEED).randbytes(BLOCK)
    with (folder / "hog").open("wb", buffering=0) as file:
        while not end.is_set():
            for _ in range(BLOCKS):
                if end.is_set():
                    return
                file.write(block)
                os.fsync(file.fileno())
            file.seek(0)


class Forger:
    """Commands of an unauthorised sender, made from those that it receives."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        self._heard: bytes | None = None
        self._first: bytes | None = None
        self.sent: Counter[str] = Counter()

    def hear(self, payload: bytes) -> None:
        """Store a command of the controller."""
        self._first = self._first or payload
        self._heard = payload

    def next(self) -> bytes | None:
        """Make the next payload, of each kind in turn; None before the first received command."""
        if self._heard is None or self._first is None:
            return None
        kind = KINDS[self.sent.total() % len(KINDS)]
        self.sent[kind] += 1
        return self._made(kind, self._heard, self._first)

    def _made(self, kind: str, heard: bytes, first: bytes) -> bytes:
        chance = self._chance
        if kind == "garbage":
            return chance.randbytes(chance.randrange(1, 200))
        if kind == "truncated":
            return heard[: chance.randrange(1, len(heard))]
        if kind == "huge":
            return heard + bytes(HUGE)
        if kind == "replay":
            return first
        command = cast(Json, msgpack.unpackb(heard))
        command["arms"][0]["voltage_V"] = {"not a number": NONSENSE, "absurd": 1e300}.get(kind, 3.0)
        command["valid"] = True
        if kind == "old epoch":
            command["epoch"] -= 1
        else:
            command["owner"] += 1
            command["seq"] += chance.randrange(0, 3)
        return cast(bytes, msgpack.packb(command))


def flood(end: threading.Event, endpoint: str, rig: str, rate_hz: float) -> Json:
    """Put forged commands at a rate; returns what was sent, by kind, and for how long."""
    config = {
        "mode": "client",
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    }
    place = f"pincette/v2/{rig}/command"
    forger = Forger(random.Random(SEED))
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:

        def hear(sample: zenoh.Sample) -> None:
            forger.hear(sample.payload.to_bytes())

        subscriber = session.declare_subscriber(place, hear, allowed_origin=zenoh.Locality.REMOTE)
        publisher = session.declare_publisher(place)
        begun = due = monotonic()
        while not end.wait(max(0.0, due - monotonic())):
            due = max(due + 1.0 / rate_hz, monotonic() - 1.0)
            made = forger.next()
            if made is not None:
                publisher.put(made)
        subscriber.undeclare()
        return {"sent": dict(forger.sent), "for_s": monotonic() - begun}


def main(words: Sequence[str]) -> None:
    """Run one of the programs until standard input closes."""
    end = threading.Event()
    received: list[Json] = []
    match words:
        case ["cpu"]:
            thread = threading.Thread(target=burn, args=(end,))
        case ["disk", folder]:
            thread = threading.Thread(target=write, args=(end, Path(folder)))
        case ["flood", endpoint, rig, rate_hz]:
            thread = threading.Thread(
                target=lambda: received.append(flood(end, endpoint, rig, float(rate_hz)))
            )
        case _:
            raise SystemExit(__doc__)
    thread.start()
    sys.stdin.read()
    end.set()
    thread.join()
    for reported in received:
        print(json.dumps(reported))


if __name__ == "__main__":
    main(sys.argv[1:])
