"""The supervisor as a program: port, store, bus, REST."""

import socket
import threading
from collections.abc import Sequence
from functools import partial
from typing import Protocol

from fastapi import FastAPI

from pincette.config import RigFile
from pincette.runtime.context import Context
from pincette.runtime.priority import stand_back
from pincette_supervisor.access.access import Access
from pincette_supervisor.access.buckets import Buckets
from pincette_supervisor.access.keeper import kept
from pincette_supervisor.access.opening import gate_of, require_key
from pincette_supervisor.config import SupervisorConfig, configure
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.planning.prediction import played
from pincette_supervisor.planning.worker import Worker
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.rest.server import server_of
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.listeners import Listeners
from pincette_supervisor.running.rig_finder import RigFinder
from pincette_supervisor.running.rigs import Rigs
from pincette_supervisor.running.taking_up import Household
from pincette_supervisor.running.waking import Waking

STOP_S = 5.0


class PortInUseError(OSError):
    """The port cannot be had; the text says which, and what to do."""


def bind(host: str, port: int) -> socket.socket:
    """Take the port, before anything else is started; raises PortInUseError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise PortInUseError(
            f"{host}:{port} is in use or cannot be had ({error.strerror}); stop the other program "
            "or set [supervisor] port in the rig file"
        ) from error
    return listener


def run(context: Context) -> None:
    """Serve REST until told to stop."""
    config = configure(context.rig, context.data)
    listener = bind(config.host, config.port)
    worker = Worker(played)
    worker.begin()
    if not context.rig.lockstep:  # which waits for whoever is late
        stand_back()
    try:
        store = Store(config.store)
        try:
            access = Access(gate_of(config), names=config.names, buckets=Buckets())
            with kept(store, access):
                require_key(config, access.gate)
                _serve(context, config, listener, store, access, worker)
        finally:
            store.close()
    finally:
        worker.close()
        listener.close()


def _serve(
    context: Context,
    config: SupervisorConfig,
    listener: socket.socket,
    store: Store,
    access: Access,
    worker: Worker,
) -> None:
    listeners, waking = Listeners(), Waking()
    household = Household(
        store, listeners, context.data, context.open_bus, partial(worker.run, played), waking
    )
    left_over = _by_rig(store, store.interrupt_left_over(utc_now()))

    def take_up(rig: RigFile) -> Conductor:
        return household.take_up(rig, left_over.pop(rig.rig.name, ()))

    everywhere = context.open_bus()
    waking.begin()
    try:
        rigs = Rigs(take_up(context.rig))
        finder = RigFinder(rigs, context.open_bus, take_up)
        try:
            finder.begin(everywhere)
            _answer(context, config, listener, create_app(rigs, access), (finder, rigs, listeners))
        finally:
            finder.close()
            rigs.release()
    finally:
        waking.close()
        everywhere.close()


def _by_rig(store: Store, jobs: list[str]) -> dict[str, list[str]]:
    """Names of jobs by their rig, in the same order."""
    found: dict[str, list[str]] = {}
    for name in jobs:
        row = store.get(name)
        if row is not None:
            found.setdefault(row.rig, []).append(name)
    return found


class Closing(Protocol):
    """What ends before the server does, so that no answer is waited for in vain."""

    def close(self) -> None:
        """End."""
        ...


def _answer(
    context: Context,
    config: SupervisorConfig,
    listener: socket.socket,
    app: FastAPI,
    behind: Sequence[Closing],
) -> None:
    """Serve REST until told to stop."""
    server = server_of(app)
    # In a thread of its own the server leaves signals to the program's start-up.
    thread = threading.Thread(target=server.run, args=([listener],), name="rest")
    thread.start()
    try:
        while thread.is_alive() and not server.started:
            context.stop.wait(0.02)
        context.ready(f"serves at http://{config.host}:{config.port}/api/v1")
        context.stop.wait()
    finally:
        for one in behind:
            one.close()
        server.should_exit = True
        thread.join(STOP_S)
