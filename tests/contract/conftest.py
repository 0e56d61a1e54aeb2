import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Literal, Protocol

import pytest

from pincette.instruments.line.memory_link import MemoryLink
from pincette.instruments.line.recording import Recorder, RecordingLink
from pincette.instruments.line.replay import ReplayLink
from pincette.instruments.protocols import Link
from pincette.security.folder import Folder
from pincette.sim.instruments.protocol import TERMINATOR, Instrument
from pincette.sim.wires.wire import serve
from tests.support.certificates import folder_for


class Reach(Protocol):
    def __call__(
        self, instrument: Instrument, terminator: bytes = TERMINATOR, /
    ) -> tuple[str, Link | None]: ...


Script = Callable[[list[bytes | None]], str]


class Understudy:
    """A replayed dialogue that knows which requests change the instrument's state."""

    def __init__(self, replay: ReplayLink, instrument: Instrument) -> None:
        self.replay = replay
        self._instrument = instrument

    def exchange(self, request: bytes) -> bytes:
        reply = self.replay.exchange(request)
        self._instrument.answer(request)
        return reply

    def tell(self, line: bytes) -> None:
        self.replay.tell(line)
        self._instrument.answer(line)

    def close(self) -> None:
        self.replay.close()


def offer_in_memory(instrument: Instrument, terminator: bytes = TERMINATOR) -> tuple[str, Link]:
    return "memory://", MemoryLink(instrument.answer, terminator)


def offer_on_a_port(wires: ExitStack, url: str) -> Reach:
    def offer(instrument: Instrument, terminator: bytes = TERMINATOR) -> tuple[str, Link | None]:
        return wires.enter_context(serve(url, instrument, terminator=terminator)).url, None

    return offer


def offer_recorded(folder: Path) -> Reach:
    numbers = count()

    def offer(instrument: Instrument, terminator: bytes = TERMINATOR) -> tuple[str, Link | None]:
        path = folder / f"{next(numbers)}.txt"
        recorder = Recorder(path, "memory://", terminator, lambda: 0.0)
        return "memory://", RecordingLink(MemoryLink(instrument.answer, terminator), recorder)

    return offer


def offer_replayed(folder: Path, played: list[ReplayLink]) -> Reach:
    numbers = count()

    def offer(instrument: Instrument, _terminator: bytes = TERMINATOR) -> tuple[str, Link | None]:
        url = f"replay:{folder / f'{next(numbers)}.txt'}"
        played.append(ReplayLink(url, lambda _link: None))
        return url, Understudy(played[-1], instrument)

    return offer


@pytest.fixture(params=["memory", "tcp", "pty", "recording"])
def reach(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Reach]:
    """Offer an instrument in one of four ways; yields the url, and the link if there is no port.

    A recording is made of this test over memory; then the test is played from it.
    """
    way: Literal["memory", "tcp", "pty", "recording"] = request.param
    if way == "memory":
        yield offer_in_memory
    elif way == "recording":
        run_dry: Callable[[Reach], None] = getattr(request.instance, request.function.__name__)
        run_dry(offer_recorded(tmp_path))
        played = list[ReplayLink]()
        yield offer_replayed(tmp_path, played)
        assert played
        assert all(replay.ended for replay in played)
    else:
        with ExitStack() as wires:
            url = "socket://127.0.0.1:0" if way == "tcp" else str(tmp_path / "port")
            yield offer_on_a_port(wires, url)


@pytest.fixture
def script() -> Iterator[Script]:
    """Serve a peer that sends the next of these replies to each request, and disconnects at
    None."""
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """Create the certificates of a rig."""
    return folder_for(tmp_path_factory.mktemp("certificates") / "pki", "demo")
