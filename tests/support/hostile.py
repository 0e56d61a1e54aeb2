"""Clients that try to starve a supervisor: ``python -m tests.support.hostile API COUNT``.

Each kind of attack has COUNT clients, which repeat it until standard input closes. Every client
waits for its answer and pauses before it repeats the attack, so that the attack costs the
supervisor more than the machine. One line of JSON then counts the answers of each kind.

The variables ``KINDS`` (names separated by commas), ``KEY`` and ``JOB`` of the environment select
the attacks, the key that those with a key show, and the job that the long polls ask for.
"""

import asyncio
import json
import os
import ssl
import subprocess
import sys
from collections import Counter
from collections.abc import Awaitable, Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from typing import cast
from urllib.parse import urlsplit

from tests.support.running import Json

PAUSE_S = 0.05
"""Pause of a client between a reply and its next attack."""
WAIT_S = 20.0
"""Longest time a client waits for an answer."""
STEP_S = 0.5
"""Time between two bytes of a slow client."""
IDLE = 500
"""Idle connections of the whole process, whatever COUNT is."""
POLLS = 20
"""Long polls of one client at once."""
MEMBERS = ("{" + ", ".join(f'"m{n:05d}": "b"' for n in range(58_000)) + "}").encode()
"""Object of 869 kB with members that no request has."""
FITTING = ("{" + ", ".join(f'"{n:x}":1' for n in range(1500)) + "}").encode()
"""Unknown members of a body that is no larger than a small request may be."""


@dataclass
class Target:
    """The supervisor that is attacked."""

    host: str
    port: int
    base: str
    tls: ssl.SSLContext | None
    key: str
    job: str
    statuses: dict[str, Counter[str]] = field(default_factory=dict[str, Counter[str]])
    numbers: "count[int]" = field(default_factory=count)

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Open a connection."""
        return await asyncio.open_connection(self.host, self.port, ssl=self.tls)

    def head(self, method: str, path: str, *lines: str, key: bool = False) -> bytes:
        """Return the head of a request."""
        own = [f"{method} {self.base}{path} HTTP/1.1", f"Host: {self.host}:{self.port}"]
        if key and self.key:
            own.append(f"Authorization: Bearer {self.key}")
        return ("\r\n".join([*own, *lines]) + "\r\n\r\n").encode()

    def with_body(self, path: str, body: bytes, *, key: bool = False) -> bytes:
        """Return a POST with a body of JSON."""
        lines = ("Content-Type: application/json", f"Content-Length: {len(body)}")
        return self.head("POST", path, *lines, key=key) + body


async def asked(target: Target, request: bytes, answers: int = 1) -> str:
    """Send a request on a connection of its own and return the status of the last answer."""
    reader, writer = await target.connect()
    try:
        writer.write(request)
        status = ""
        for _ in range(answers):
            line = await reader.readline()
            status = line[9:12].decode() if line else "closed"
            if not line:
                break
            head = await reader.readuntil(b"\r\n\r\n")
            length = [h for h in head.lower().split(b"\r\n") if h.startswith(b"content-length:")]
            await reader.readexactly(int(length[0][15:]) if length else 0)
        return status
    finally:
        writer.transport.abort()


async def dripped(target: Target, request: bytes) -> str:
    """Send a request byte by byte; the answer, or the end of the connection, ends it."""
    reader, writer = await target.connect()
    try:
        first = asyncio.ensure_future(reader.readline())
        for place in range(len(request)):
            writer.write(request[place : place + 1])
            done, _ = await asyncio.wait([first], timeout=STEP_S)
            if done:
                return first.result()[9:12].decode() or "closed"
        return (await first)[9:12].decode() or "closed"
    finally:
        writer.transport.abort()


async def members(target: Target) -> str:
    """Send a large object with unknown members without a key."""
    return await asked(target, target.with_body("/session", MEMBERS))


async def members_with_key(target: Target) -> str:
    """Send a large object with unknown members to a route that plans, with a key."""
    return await asked(target, target.with_body("/jobs?dry_run=true", MEMBERS, key=True))


async def fitting_members(target: Target) -> str:
    """Send unknown members within the allowed size, with a key."""
    return await asked(target, target.with_body("/jobs?dry_run=true", FITTING, key=True))


async def deep(target: Target) -> str:
    """Send deeply nested lists, with a key."""
    body = b'{"kind": "grip", "labels": ' + b"[" * 8000 + b"]" * 8000 + b"}"
    return await asked(target, target.with_body("/jobs?dry_run=true", body, key=True))


async def invented_names(target: Target) -> str:
    """Sign in with an unknown name."""
    words = {"user": f"user{next(target.numbers)}", "password": "wrong password"}
    return await asked(target, target.with_body("/session", json.dumps(words).encode()))


async def long_polls(target: Target) -> str:
    """Hold many long polls at once, with a key."""
    head = target.head("GET", f"/jobs/{target.job}?wait=change&timeout_s=15", key=True)
    answers = await asyncio.gather(*(asked(target, head) for _ in range(POLLS)))
    return max(answers)


async def tiny_chunks(target: Target) -> str:
    """Send a body in chunks of one byte."""
    head = target.head(
        "POST", "/session", "Content-Type: application/json", "Transfer-Encoding: chunked"
    )
    return await asked(target, head + b"1\r\n \r\n" * 100_000 + b"0\r\n\r\n")


async def many_headers(target: Target) -> str:
    """Send as many headers as a head has room for."""
    return await asked(target, target.head("GET", "/rigs", *["a:b"] * 3000, key=True))


async def many_parameters(target: Target) -> str:
    """Send a long query of many parameters."""
    query = "&".join(f"{n:x}" for n in range(3500))
    return await asked(target, target.head("GET", f"/jobs?{query}", key=True))


async def many_cookies(target: Target) -> str:
    """Send a long cookie with many parts."""
    cookie = ";".join(f"{n:x}=" for n in range(2500))
    return await asked(target, target.head("GET", "/rigs", f"Cookie: {cookie}"))


async def pipelined(target: Target) -> str:
    """Send many requests at once over one connection."""
    return await asked(target, target.head("GET", "/session") * 100, 100)


async def slow_head(target: Target) -> str:
    """Send a head byte by byte."""
    return await dripped(target, target.head("GET", "/rigs"))


async def slow_body(target: Target) -> str:
    """Send a body byte by byte."""
    lines = ("Content-Type: application/json", "Content-Length: 500")
    head = target.head("POST", "/session", *lines)
    reader, writer = await target.connect()
    try:
        writer.write(head)
        first = asyncio.ensure_future(reader.readline())
        while not (await asyncio.wait([first], timeout=STEP_S))[0]:
            writer.write(b" ")
        return first.result()[9:12].decode() or "closed"
    finally:
        writer.transport.abort()


async def half_handshake(target: Target) -> str:
    """Begin a TLS handshake, wait for the server's part of it, and disconnect."""
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    context = target.tls or ssl.create_default_context()
    client = context.wrap_bio(incoming, outgoing, server_hostname=target.host)
    with suppress(ssl.SSLWantReadError):
        client.do_handshake()
    reader, writer = await asyncio.open_connection(target.host, target.port)
    try:
        writer.write(outgoing.read())
        return "answered" if await reader.read(1) else "closed"
    finally:
        writer.transport.abort()


ATTACKS: Mapping[str, Callable[[Target], Awaitable[str]]] = {
    attack.__name__: attack
    for attack in (
        members,
        members_with_key,
        fitting_members,
        deep,
        invented_names,
        long_polls,
        tiny_chunks,
        many_headers,
        many_parameters,
        many_cookies,
        pipelined,
        slow_head,
        slow_body,
        half_handshake,
    )
}


async def repeated(target: Target, name: str, end: asyncio.Event) -> None:
    """Repeat an attack until the end."""
    answers = target.statuses.setdefault(name, Counter())
    while not end.is_set():
        try:
            async with asyncio.timeout(WAIT_S):
                answers[await ATTACKS[name](target)] += 1
        except TimeoutError:
            answers["none in time"] += 1
        except (OSError, asyncio.IncompleteReadError):
            answers["closed"] += 1
        await asyncio.sleep(PAUSE_S)


async def idle(target: Target, end: asyncio.Event) -> None:
    """Hold connections and send nothing; those that are closed are opened again."""
    while not end.is_set():
        held: list[asyncio.StreamWriter] = []
        for _ in range(IDLE):
            with suppress(OSError):
                held.append((await asyncio.open_connection(target.host, target.port))[1])
        with suppress(TimeoutError):
            await asyncio.wait_for(end.wait(), 5.0)
        for writer in held:
            writer.transport.abort()


async def attack(target: Target, clients: int, kinds: list[str]) -> None:
    """Attack until standard input closes."""
    end = asyncio.Event()
    own = [asyncio.ensure_future(repeated(target, name, end)) for name in kinds * clients]
    own.append(asyncio.ensure_future(idle(target, end)))
    await asyncio.to_thread(sys.stdin.read)
    end.set()
    for one in own:
        one.cancel()
    await asyncio.gather(*own, return_exceptions=True)


@contextmanager
def attacked(
    api: str,
    clients: int,
    *,
    key: str = "",
    job: str = "none",
    kinds: tuple[str, ...] = tuple(ATTACKS),
) -> Generator[dict[str, dict[str, int]]]:
    """Attack as long as the block lasts; the yielded dictionary then counts the answers."""
    words = [sys.executable, "-m", "tests.support.hostile", api, str(clients)]
    own = {**os.environ, "KINDS": ",".join(kinds), "KEY": key, "JOB": job}
    process = subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=own
    )
    tally: dict[str, dict[str, int]] = {}
    try:
        yield tally
    finally:
        output, _ = process.communicate(timeout=2 * WAIT_S)
    tally.update(cast("dict[str, dict[str, int]]", json.loads(output)))


def main(api: str, clients: int) -> Json:
    """Attack until standard input closes, and count the answers of each kind."""
    place = urlsplit(api)
    tls = None
    if place.scheme == "https":
        tls = ssl.create_default_context()
        tls.check_hostname, tls.verify_mode = False, ssl.CERT_NONE
    target = Target(
        place.hostname or "",
        place.port or 0,
        place.path.rstrip("/"),
        tls,
        os.environ["KEY"],
        os.environ["JOB"],
    )
    asyncio.run(attack(target, clients, os.environ["KINDS"].split(",")))
    return {name: dict(found) for name, found in target.statuses.items()}


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], int(sys.argv[2]))))
