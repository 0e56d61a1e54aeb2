"""Programs outside the loop: the context that each receives at its start, and the router."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pincette.bus.endpoints import router_endpoint, upstream_endpoint
from pincette.bus.session import AskRouter, serve_router
from pincette.bus.settings import lease_s
from pincette.bus.topology import SessionConfig
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.core.listening import bound
from pincette.engine.realtime.os_scheduling import raise_priority
from pincette.engine.router_watch import LEASES, RouterWatch, end_process


class OpenBus(Protocol):
    """Function that joins the bus of the rig file's rig, or of another named one."""

    def __call__(self, rig: str | None = None, *, lockstep: bool | None = None) -> ZenohBus:
        """Join a bus; raises BusError.

        ``lockstep`` is that of the named rig; None: as in the rig file.
        """
        ...


@dataclass(frozen=True)
class Context:
    """Argument of a program of ``pincette.programs``, which returns when ``stop`` is set."""

    rig: RigFile
    data: Path
    """Folder of records and the journal."""
    open_bus: OpenBus
    """Function that joins the bus as a client of the router; the program closes the bus."""
    ready: Callable[[str], None]
    """Function that reports, in one line, that the program serves."""
    stop: threading.Event


def require_port(host: str, port: int, table: str) -> None:
    """Raise OSError with reason and remedy if a program cannot listen at a port.

    ``table``: the table of the rig file that names the port.
    """
    try:
        bound(host, port).close()
    except OSError as error:
        why = f"{error.strerror}. In the rig file: {table} host and port"
        raise OSError(error.errno, why) from error


def run_router(context: Context) -> None:
    """Run the router of a rig until stopped."""
    if not context.rig.lockstep:
        raise_priority(context.rig.realtime.of("router"))
    _route(context, router_endpoint(context.rig), "router")


def run_upstream(context: Context) -> None:
    """Run a laboratory server's router, to which the routers of rigs connect, until stopped."""
    _route(context, upstream_endpoint(context.rig), "upstream")


def _route(context: Context, config: SessionConfig, name: str) -> None:

    def wait(ask: AskRouter) -> None:
        watch = RouterWatch(ask, LEASES * lease_s(config), end_process)
        watch.start()
        context.ready(f"routes at {config.listen[0]}")
        context.stop.wait()
        watch.close()

    serve_router(config, context.rig.rig.name, wait, name)
