"""Port for viewers that checks the origin of a page; the server behind it does not.

A browser sends the origin of the page in the header Origin of every WebSocket request, and a page
cannot change this header (RFC 6455, 10.2). Other programs send no such header, and are accepted.
"""

import asyncio
import logging
import socket
import ssl
import threading
from collections.abc import Collection
from urllib.parse import urlsplit

from pincette.core.listening import why_not

log = logging.getLogger("pincette.foxglove")
HEAD_S = 5.0
"""Time limit for receiving the request of a new connection, including the TLS handshake, in s."""
HEAD_BYTES = 16_384
MOST = 256
"""Largest number of simultaneous connections; further ones are closed."""
BACKLOG = 1024
CHUNK = 65_536
LOOPBACK = ("localhost", "127.0.0.1", "::1")


class Door:
    """Listener that accepts connections in its own thread, and forwards permitted ones to the
    server.
    """

    def __init__(
        self,
        place: tuple[str, int],
        behind: tuple[str, int],
        origins: Collection[str],
        proof: ssl.SSLContext | None = None,
    ) -> None:
        """Listen at ``place``; raises OSError if it is in use.

        ``origins`` are pages that may connect, in addition to those that this machine serves
        itself. ``proof`` is the TLS context; TLS is terminated here.
        """
        self._behind, self._origins, self._proof = behind, frozenset(origins), proof
        self._open, self._told = 0, set[str]()
        try:
            family = socket.getaddrinfo(*place, type=socket.SOCK_STREAM)[0][0]
            self._listener = socket.create_server(place, family=family, backlog=BACKLOG)
        except OSError as error:
            why = f"{why_not(*place, error)}. In the rig file: [foxglove] host and port"
            raise OSError(error.errno, why) from error
        self._loop, self._over = asyncio.new_event_loop(), asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="door", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End every connection."""
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join()

    def _run(self) -> None:
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        server = await asyncio.start_server(
            self._take,
            sock=self._listener,
            limit=HEAD_BYTES,
            ssl=self._proof,
            ssl_handshake_timeout=None if self._proof is None else HEAD_S,
        )
        await self._over.wait()
        server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for one in others:
            one.cancel()
        await asyncio.gather(*others, return_exceptions=True)
        await asyncio.sleep(0)  # let the closed transports end their connections

    async def _take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            if self._open <= MOST:
                await self._lead(reader, writer)
        except (OSError, EOFError, TimeoutError, asyncio.LimitOverrunError) as error:
            log.debug("a connection ended: %s", error)
        finally:
            self._open -= 1
            writer.close()

    async def _lead(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with asyncio.timeout(HEAD_S):
            head = await reader.readuntil(b"\r\n\r\n")
        if (origin := self.foreign(head)) is not None:
            self._tell(origin)
            writer.write(refusal(origin))
            await writer.drain()
            return
        there, back = await asyncio.open_connection(*self._behind)
        back.write(head)
        await asyncio.gather(_carry(reader, back), _carry(there, writer))

    def foreign(self, head: bytes) -> str | None:
        """Return the origin of a request if it may not connect; None if it may."""
        for line in head.decode("latin-1").split("\r\n")[1:]:
            name, _, origin = line.partition(":")
            origin = origin.strip()
            if name.strip().lower() == "origin" and not (
                origin in self._origins or _is_of_this_machine(origin)
            ):
                return origin
        return None

    def _tell(self, origin: str) -> None:
        if origin not in self._told and len(self._told) < MOST:  # log each origin once
            self._told.add(origin)
            log.warning("refused a page with origin %.100r; see [foxglove] origins", origin)


def _is_of_this_machine(origin: str) -> bool:
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.hostname in LOOPBACK


def refusal(origin: str) -> bytes:
    """Return the reply to a rejected page; a browser shows its own text instead."""
    text = f"a page from {origin[:100]!r} may not connect: name it in [foxglove] origins\n".encode()
    lines = (
        "HTTP/1.1 403 Forbidden",
        "Content-Type: text/plain; charset=utf-8",
        f"Content-Length: {len(text)}",
        "Connection: close",
    )
    return "".join(f"{line}\r\n" for line in (*lines, "")).encode() + text


async def _carry(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    """Copy bytes until either end is closed; a slow reader also slows the sender down."""
    try:
        while data := await source.read(CHUNK):
            sink.write(data)
            await sink.drain()
    except OSError as error:
        log.debug("a connection ended: %s", error)
    finally:
        sink.close()
