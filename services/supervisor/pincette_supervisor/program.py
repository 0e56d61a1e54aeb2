"""The supervisor as a program: port, store, bus, REST."""

import socket
import threading
from concurrent.futures import ThreadPoolExecutor

import uvicorn

from pincette.runtime.context import Context
from pincette.runtime.priority import stand_back
from pincette_supervisor.config import SupervisorConfig, configure
from pincette_supervisor.journal.store import Store, utc_now
from pincette_supervisor.model.rig_model import RigModel
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.results import archive
from pincette_supervisor.running.conductor import Conductor
from pincette_supervisor.running.events import EventLog
from pincette_supervisor.running.health import Health
from pincette_supervisor.running.observer import Observer
from pincette_supervisor.running.site import Site

ESTOP_THREADS = 4
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
    stand_back()
    try:
        store = Store(config.store)
        try:
            _serve(context, config, listener, store)
        finally:
            store.close()
    finally:
        listener.close()


def _serve(
    context: Context, config: SupervisorConfig, listener: socket.socket, store: Store
) -> None:
    bus = context.open_bus()
    estop_pool = ThreadPoolExecutor(ESTOP_THREADS, thread_name_prefix="estop")
    archivist = archive.archivist()
    try:
        observer = Observer(bus)
        health = Health(context.rig, bus, observer, store)
        model = RigModel(context.rig, config.models, store)
        events = EventLog(store, context.rig.rig.name)
        site = Site(model, bus, observer, health, store, events, config.records, archivist)
        conductor = Conductor(site)
        health.refresh()
        conductor.recover(store.interrupt_left_over(utc_now()))
        server = uvicorn.Server(
            uvicorn.Config(
                create_app(conductor, estop_pool),
                log_config=None,
                log_level="warning",
                access_log=False,
                lifespan="off",
                timeout_graceful_shutdown=2,
            )
        )
        # In a thread of its own the server leaves signals to the program's start-up.
        thread = threading.Thread(target=server.run, args=([listener],), name="rest")
        thread.start()
        try:
            while thread.is_alive() and not server.started:
                context.stop.wait(0.02)
            context.ready(f"serves at http://{config.host}:{config.port}/api/v1")
            context.stop.wait()
        finally:
            conductor.close()
            events.close()
            server.should_exit = True
            thread.join(STOP_S)
            health.close()
    finally:
        estop_pool.shutdown(wait=False, cancel_futures=True)
        archivist.shutdown(cancel_futures=True)
        bus.close()
