"""The body of a response does not wait for the acknowledgement of its head."""

import asyncio
import socket
from typing import Any

from fastapi import FastAPI

from pincette_supervisor.rest.server import server_of


def test_accepted_connections_have_no_send_delay() -> None:
    server = server_of(FastAPI())
    server.config.load()
    server.lifespan = server.config.lifespan_class(server.config)
    accepted: list[int] = []

    async def connect(listener: socket.socket) -> None:
        await server.startup([listener])
        reader, writer = await asyncio.open_connection(*listener.getsockname())
        writer.write(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        await reader.readline()
        for connection in server.server_state.connections:
            transport: Any = getattr(connection, "transport")  # noqa: B009 - of either protocol
            sock = transport.get_extra_info("socket")
            accepted.append(sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
        writer.close()
        await server.shutdown([listener])

    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        asyncio.run(connect(listener))
    assert len(accepted) == 1
    assert all(accepted)
