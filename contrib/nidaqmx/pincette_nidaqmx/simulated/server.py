"""Simulated NI gRPC Device Server on a port; it passes any call's bytes to the instrument."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from urllib.parse import urlsplit

import grpc

from pincette.core.listening import bound
from pincette.sim.instruments.protocol import Instrument
from pincette.sim.wires.ports import WireError

WORKERS = 4
MOST_BYTES = 64 * 1024 * 1024
GRACE_S = 0.5

_grpc: Any = grpc


class DaqServer:
    """Serves one instrument until it is closed; raises WireError.

    The gRPC status is DEADLINE_EXCEEDED (without waiting) for a silent instrument, UNAVAILABLE for
    a disconnected one, as for a lost server, and DATA_LOSS for a reply of unknown type.
    """

    def __init__(self, url: str, instrument: Instrument) -> None:
        host, port = _address(url)
        self._instrument = instrument
        self._server = _grpc.server(
            ThreadPoolExecutor(WORKERS, thread_name_prefix=url),
            handlers=(_AnyCall(self._carry_out),),
            options=(
                ("grpc.so_reuseport", 0),
                ("grpc.max_receive_message_length", MOST_BYTES),
                ("grpc.max_send_message_length", MOST_BYTES),
            ),
        )
        try:
            bound(host, port).close()
            listens_at = self._server.add_insecure_port(f"{host}:{port}")
        except (OSError, RuntimeError) as error:
            why = getattr(error, "strerror", None) or error
            raise WireError(f"simulated instrument: {why}. In the rig file: its url") from error
        self.url = f"grpc://{host}:{listens_at}"
        self._server.start()

    def close(self) -> None:
        """Hang up and free the port; repeated calls do nothing."""
        self._server.stop(GRACE_S).wait()

    def __enter__(self) -> "DaqServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _carry_out(self, method: str, message: bytes, context: Any) -> bytes:
        try:
            reply = self._instrument.answer(method.encode() + b"\0" + message)
        except ConnectionResetError as error:
            return _refused(context, "UNAVAILABLE", str(error))
        if reply is None:
            return _refused(context, "DEADLINE_EXCEEDED", "silence")
        kind, _, rest = reply.partition(b"\0")
        if kind == b"ok":
            return rest
        word, parted, text = rest.decode(errors="replace").partition("\0")
        if parted and kind == b"ni-error":
            context.set_trailing_metadata((("ni-error", word),))
            return _refused(context, "UNKNOWN", text)
        return _refused(context, word if parted and kind == b"status" else "DATA_LOSS", text)


def _refused(context: Any, name: str, words: str) -> bytes:
    """End a call with a status; no message is sent."""
    context.set_code(_grpc.StatusCode.__members__.get(name, _grpc.StatusCode.UNKNOWN))
    context.set_details(words)
    return b""


class _AnyCall(grpc.GenericRpcHandler):
    """Passes each call to one function, for any method; messages stay bytes."""

    def __init__(self, carry_out: Callable[[str, bytes, Any], bytes]) -> None:
        self._carry_out = carry_out

    def service(self, handler_call_details: Any) -> Any:
        """Return the handler of the call."""
        method: str = handler_call_details.method

        def carry_out(message: bytes, context: Any) -> bytes:
            return self._carry_out(method, message, context)

        return _grpc.unary_unary_rpc_method_handler(carry_out)


def _address(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        if parts.scheme == "grpc" and parts.hostname and parts.port is not None:
            host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
            return host, parts.port
    except ValueError as error:
        raise WireError(f"{url}: {error}") from error
    raise WireError(f"{url}: a simulated NI device needs grpc://host:port/DEVICE/CHANNEL")
