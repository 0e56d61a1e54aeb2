import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Literal, Protocol

import pytest

from pincette.instruments.memory_link import MemoryLink
from pincette.instruments.protocols import Link
from pincette.sim.instrument import TERMINATOR, Instrument
from pincette.sim.wire import serve


class Reach(Protocol):
    def __call__(
        self, instrument: Instrument, terminator: bytes = TERMINATOR
    ) -> tuple[str, Link | None]: ...


Script = Callable[[list[bytes | None]], str]


@pytest.fixture(params=["memory", "tcp", "pty"])
def reach(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Reach]:
    """Offer an instrument in one of three ways: the url, and the link where there is no port."""
    way: Literal["memory", "tcp", "pty"] = request.param
    with ExitStack() as wires:

        def offer(
            instrument: Instrument, terminator: bytes = TERMINATOR
        ) -> tuple[str, Link | None]:
            if way == "memory":
                return "memory://", MemoryLink(instrument.answer)
            url = "socket://127.0.0.1:0" if way == "tcp" else str(tmp_path / "port")
            return wires.enter_context(serve(url, instrument, terminator=terminator)).url, None

        yield offer


@pytest.fixture
def script() -> Iterator[Script]:
    """A peer that answers each request by the next of these bytes, and hangs up at None."""
    listener = socket.create_server(("127.0.0.1", 0))
    threads = list[threading.Thread]()

    def play(replies: list[bytes | None]) -> None:
        peer, _ = listener.accept()
        with peer:
            for reply in replies:
                request = b""
                while not request.endswith(b"\r"):
                    request += peer.recv(1)
                if reply is None:
                    return
                peer.sendall(reply)
            peer.recv(1)

    def begin(replies: list[bytes | None]) -> str:
        threads.append(threading.Thread(target=play, args=(replies,), daemon=True))
        threads[-1].start()
        return f"socket://127.0.0.1:{listener.getsockname()[1]}"

    yield begin
    for thread in threads:
        thread.join(timeout=5.0)
    listener.close()
    assert not any(thread.is_alive() for thread in threads)
