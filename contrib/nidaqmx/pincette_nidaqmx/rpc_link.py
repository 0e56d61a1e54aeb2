"""Line to an instrument that is called by gRPC: each call is one exchange of bytes.

A request is the method's full name, NUL and the serialized message. A reply begins with one of

    ok NUL message                the message that the method returned
    ni-error NUL code NUL text    the instrument has rejected the call; code and text are in the
                                  metadata that NI's servers add
    status NUL name NUL text      the server cannot execute the call

so that calls are logged, recorded and replayed like the lines of a serial port. A call without any
reply raises InstrumentError. This is the only file that opens a gRPC channel.
"""

import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from urllib.parse import urlsplit

import grpc
from google.protobuf.message import DecodeError

from pincette.instruments.line.recording import Recorder, RecordingLink
from pincette.instruments.line.replay import REPLAY, ReplayLink
from pincette.instruments.line.serial_link import RETRY_S, escaped
from pincette.instruments.protocols import ErrorCode, InstrumentError, Link

OK, NI_ERROR, STATUS = b"ok", b"ni-error", b"status"
MOST_BYTES = 64 * 1024 * 1024
LOST: dict[str, ErrorCode] = {
    "UNAVAILABLE": "hung_up",
    "CANCELLED": "hung_up",
    "DEADLINE_EXCEEDED": "silent",
    "DATA_LOSS": "garbled",
}
"""Error codes by the gRPC statuses of a call without a readable reply."""

_grpc: Any = grpc
_log = logging.getLogger(__name__)

Metadata = tuple[tuple[str, str], ...]


def open_rpc_link(
    url: str, *, timeout_s: float, patience_s: float, quick: frozenset[str], metadata: Metadata,
    record: str | None = None, clock: Callable[[], float] = time.monotonic,
) -> Link:  # fmt: skip
    """Open a line to ``grpc://host:port/…``, or play the recording of ``replay:FILE``.

    Nothing is sent: the first call connects, and later ones connect again if the server was lost.

    Parameters
    ----------
    timeout_s
        Timeout of calls whose method name, without its path, is in ``quick``.
    patience_s
        Timeout of all other calls, which may set up hardware; at least ``timeout_s``.
    metadata
        Metadata that is sent with each call.
    record
        File to which each exchange is written.

    Raises
    ------
    InstrumentError
        If the url names no server, or the recording cannot be read or written.
    """
    if url.startswith(REPLAY):
        return ReplayLink(url, lambda _link: None)
    link: Link = RpcLink(url, timeout_s, max(timeout_s, patience_s), quick, metadata)
    return RecordingLink(link, Recorder(Path(record), url, b"", clock)) if record else link


class RpcLink:
    """Open channel to a server; only one thread at a time may call it."""

    def __init__(
        self,
        url: str,
        timeout_s: float,
        patience_s: float,
        quick: frozenset[str],
        metadata: Metadata,
    ) -> None:
        self._url = url
        self._timeout_s = timeout_s
        self._patience_s = patience_s
        self._quick = quick
        self._metadata = metadata
        self._calls: dict[str, tuple[Callable[..., bytes], float]] = {}
        retry_ms = round(1e3 * RETRY_S)
        self._channel = _grpc.insecure_channel(
            _address(url),
            options=(
                ("grpc.initial_reconnect_backoff_ms", retry_ms),
                ("grpc.min_reconnect_backoff_ms", retry_ms),
                ("grpc.max_reconnect_backoff_ms", retry_ms),
                ("grpc.max_receive_message_length", MOST_BYTES),
                ("grpc.max_send_message_length", MOST_BYTES),
            ),
        )
        self._closed = False

    def exchange(self, request: bytes) -> bytes:
        """Call a method and return its reply; raises InstrumentError if there is none."""
        if self._closed:
            raise InstrumentError(f"{self._url}: the port is closed; open it again", "misused")
        name, _, message = request.partition(b"\0")
        method = name.decode("latin-1")
        try:
            call, within_s = self._calls[method]
        except KeyError:
            call, within_s = self._calls[method] = self._made(method)
        try:
            reply = OK + b"\0" + call(message, timeout=within_s, metadata=self._metadata)
        except grpc.RpcError as error:
            reply = self._refused(method, error, within_s)
        if _log.isEnabledFor(logging.DEBUG):
            _log.debug("%s: %s -> %s", self._url, escaped(request), escaped(reply))
        return reply

    def tell(self, line: bytes) -> None:
        """Call a method and ignore its reply; raises InstrumentError."""
        self.exchange(line)

    def close(self) -> None:
        """Close the channel; repeated calls do nothing."""
        if not self._closed:
            self._closed = True
            self._channel.close()

    def _made(self, method: str) -> tuple[Callable[..., bytes], float]:
        """Return a function that calls a method with bytes, and the timeout of the method in s."""
        quick = method.rpartition("/")[2] in self._quick
        call = self._channel.unary_unary(method, None, None)
        return call, self._timeout_s if quick else self._patience_s

    def _refused(self, method: str, error: Any, within_s: float) -> bytes:
        name, text = str(error.code().name), str(error.details())
        for key, value in error.trailing_metadata() or ():
            if key == NI_ERROR.decode():
                return b"\0".join((NI_ERROR, str(value).encode(), text.encode()))
        if name in LOST:
            last = method.rpartition("/")[2]
            raise InstrumentError(
                f"{self._url}: no answer to {last} within {within_s:g} s ({name}: {text}); is the "
                "device server, or `pincette run rig`, running at this address?",
                LOST[name],
            )
        return b"\0".join((STATUS, name.encode(), text.encode()))


def _address(url: str) -> str:
    try:
        parts = urlsplit(url)
        if parts.scheme == "grpc" and parts.hostname and parts.port:
            return parts.netloc
    except ValueError:
        pass
    raise InstrumentError(
        f"{url}: no server in it; expected grpc://HOST:PORT/CHANNEL", "cannot_open"
    )


class _Entry(NamedTuple):
    key: str
    value: str


class _CallError(grpc.RpcError):
    """Error for a call that the server, or the instrument behind it, has rejected."""

    def __init__(self, status: str, text: str, code: str = "") -> None:
        super().__init__(text)
        self._status, self._text = status, text
        self._trailing = (_Entry(NI_ERROR.decode(), code),) if code else ()

    def code(self) -> Any:
        return _grpc.StatusCode.__members__.get(self._status, _grpc.StatusCode.UNKNOWN)

    def details(self) -> str:
        return self._text

    def trailing_metadata(self) -> Any:
        return self._trailing


class LinkChannel:
    """Link with the methods of a gRPC channel that a generated stub needs.

    A call returns the decoded message, raises grpc.RpcError if the server rejects it, and
    InstrumentError if the link fails or returns no reply of this type.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def unary_unary(
        self,
        method: str,
        request_serializer: Callable[[Any], bytes],
        response_deserializer: Callable[[bytes], Any],
        **_how: object,
    ) -> Callable[..., Any]:
        """Return the callable of a method."""
        head = method.encode() + b"\0"

        def call(request: Any, **_how: object) -> Any:
            message = _message(head[:-1], self._link.exchange(head + request_serializer(request)))
            try:
                return response_deserializer(message)
            except DecodeError as error:
                text = (
                    f"{method}: the answer {escaped(message[:40])!r} is not a valid message "
                    f"({error})"
                )
                raise InstrumentError(text) from error

        return call

    def unary_stream(self, method: str, *_form: object, **_how: object) -> Callable[..., NoReturn]:
        """Return a callable that fails: a link carries one reply to one request."""

        def call(*_request: object, **_how: object) -> NoReturn:
            raise InstrumentError(f"{method}: this link does not support streams", "misused")

        return call

    stream_unary = unary_stream
    stream_stream = unary_stream


def _message(method: bytes, reply: bytes) -> bytes:
    kind, _, rest = reply.partition(b"\0")
    if kind == OK and len(reply) > len(OK):
        return rest
    word, parted, text = rest.partition(b"\0")
    if kind == NI_ERROR and parted and word.removeprefix(b"-").isdigit():
        raise _CallError("UNKNOWN", text.decode(errors="replace"), word.decode())
    if kind == STATUS and parted:
        raise _CallError(word.decode(errors="replace"), text.decode(errors="replace"))
    raise InstrumentError(
        f"{escaped(method)}: the answer {escaped(reply[:40])!r} is not a reply to it"
    )
