"""The supervisor as a program: its port, journal, rigs and REST server.

It restarts itself when the bus no longer delivers messages to it: a link may be up and deliver
nothing, and in such cases only a new process has helped. The loop continues meanwhile, and a held
part stays held.
"""

import errno
import logging
import os
import socket
import ssl
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from math import inf
from pathlib import Path
from time import monotonic

from fastapi import FastAPI

from pincette.bus.endpoints import direct_endpoint
from pincette.bus.protocol import BusError
from pincette.bus.stopping import trip_at
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import RigFile
from pincette.core.listening import bound
from pincette.core.messages import Message, Trip
from pincette.engine.program import Context, OpenBus
from pincette.engine.threads import RepeatedAction
from pincette.security.identity import SUPERVISOR, program
from pincette_supervisor.access.access import (
    Access,
    KeySync,
    TokenBuckets,
    authenticator_of,
    require_key,
)
from pincette_supervisor.config import configure
from pincette_supervisor.fleet.rig_finder import RigFinder
from pincette_supervisor.fleet.rigs import RigFactory, Rigs
from pincette_supervisor.jobs.job_manager import JobManager
from pincette_supervisor.journal.events import Listeners
from pincette_supervisor.journal.store import Store, StoreError, utc_now
from pincette_supervisor.notify import Outbox, senders_of
from pincette_supervisor.planning.prediction import played
from pincette_supervisor.planning.worker import Worker
from pincette_supervisor.plugin import import_functions
from pincette_supervisor.process_load import PROCESS_LOAD
from pincette_supervisor.rest.api import create_app
from pincette_supervisor.rest.connections import server_context
from pincette_supervisor.rest.server import server_of
from pincette_supervisor.results.archive import picture
from pincette_supervisor.rigs.latch import OtherRigs
from pincette_supervisor.rigs.observer import SuspendAwareClock
from pincette_supervisor.rigs.rig_context import RigContext
from pincette_supervisor.traces import trace_senders

log = logging.getLogger("pincette")
STOP_S = 5.0
TAKEN_LOOK_S, TAKEN_LOGGED_S = 0.5, 300.0
"""Interval in s of attempts to bind a port that another program uses, and of their log lines."""
GONE_S, LOOK_S = 5.0, 0.1
"""Longest wait in s until another supervisor's token of the rig vanishes, and the interval of the
checks.
"""


class PortInUseError(OSError):
    """Error raised if the supervisor cannot listen at its port; the text states the remedy."""


def bind(host: str, port: int) -> socket.socket:
    """Bind the port before anything else is started; raises PortInUseError."""
    try:
        return bound(host, port)
    except OSError as error:
        raise PortInUseError(
            error.errno, f"{error.strerror}. In the rig file: [supervisor] host and port"
        ) from error


def await_port(host: str, port: int, stop: threading.Event) -> tuple[socket.socket | None, float]:
    """Bind the port; while another program uses it, log that and retry.

    Returns the socket, or None after a stop, and how long the port was in use, in s. Raises
    PortInUseError if binding fails for another reason.
    """
    begun_s, said_s = monotonic(), -inf
    while not stop.is_set():
        try:
            return bind(host, port), 0.0 if said_s == -inf else monotonic() - begun_s
        except PortInUseError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            if monotonic() - said_s >= TAKEN_LOGGED_S:
                said_s = monotonic()
                log.error("%s. This supervisor tries again until the port is free", error.strerror)
        stop.wait(TAKEN_LOOK_S)
    return None, 0.0


def run(context: Context) -> None:
    """Serve REST until the program is stopped."""
    config = configure(context.rig, context.data)
    # Without a writable folder, matplotlib uses a temporary one, or draws nothing.
    os.environ.setdefault("MPLCONFIGDIR", str(context.data.absolute() / "matplotlib"))
    with ExitStack() as stack:
        bound_to, taken_s = await_port(config.host, config.port, context.stop)
        if bound_to is None:
            return
        listener = stack.enter_context(closing(bound_to))
        worker = stack.enter_context(closing(Worker(played)))
        worker.begin()
        # Started with the first record. Predictions do not wait for pictures.
        artist = stack.enter_context(closing(Worker(picture)))
        import_functions()
        store = stack.enter_context(closing(Store(config.store, config.store_url)))
        store.work_alone()
        access = Access(
            authenticator_of(config, store.identifier()),
            names=config.names,
            buckets=TokenBuckets(),
            clients_per_address=config.clients_per_address,
        )
        stack.enter_context(closing(KeySync(store, access)))
        require_key(config, access.authenticator)
        bus = stack.enter_context(closing(context.open_bus()))  # this checks the certificate
        serve_alone(bus, context.rig.rig.name, context.stop)
        tls = None if config.tls is None else server_context(config.tls)
        clock = SuspendAwareClock()
        stack.enter_context(closing(PROCESS_LOAD)).start(clock.sample)
        senders = senders_of(context.rig.supervisor, context.data)
        senders += trace_senders(os.environ, store)
        stack.enter_context(closing(Outbox(store, senders)))
        listeners = Listeners()
        own_buses: list[ZenohBus] = []

        def open_bus(rig: str, *, lockstep: bool) -> ZenohBus:
            opened = context.open_bus(rig, lockstep=lockstep)
            if rig == context.rig.rig.name:
                own_buses.append(opened)
            return opened

        factory = RigFactory(
            store,
            listeners,
            context.data,
            open_bus,
            partial(worker.run, played),
            artist.run_somewhere,
            clock,
            partial(_trip_directly, context.rig),
        )
        unfinished = _by_rig(store, interrupted(store))

        def create(rig: RigFile) -> JobManager:
            return factory.create(rig, unfinished.pop(rig.rig.name, ()))

        others = stack.enter_context(closing(OtherRigs(partial(context.open_bus, lockstep=False))))
        rigs = Rigs(create(context.rig), others.stop)
        stack.callback(rigs.release)
        finder = stack.enter_context(closing(RigFinder(rigs, others, create)))
        finder.start(bus)
        stack.enter_context(rest_server(listener, create_app(rigs, access), tls, context.stop))
        # These end before the server, so that no request waits for them.
        for close in (listeners.close, rigs.close, finder.close):
            stack.callback(close)
        if taken_s:
            rigs.own.context.alarms.raise_alarm(
                "port",
                f"another program was using port {config.port} for {taken_s:.0f} s"
                + (
                    "" if config.tls else ": replace keys and passwords that clients sent meanwhile"
                ),
                severity="alarm",
                clears="acknowledge",
            )
        if not context.rig.lockstep:  # in lockstep programs may take any time
            watch = LoopbackWatch(
                # The session that checks must not be the one that holds the token.
                lambda: _hears_itself(own_buses[-1]),
                partial(can_join, context.open_bus),
                partial(restart, rigs.own.context),
            )
            stack.enter_context(closing(watch)).start()
        context.ready(f"serves at {config.url}/api/v1")
        context.stop.wait()


def _trip_directly(own: RigFile, rig: RigFile, trip: Trip) -> Message:
    """Trip the actuator of a rig without the router, with the supervisor's own certificates."""
    if own.bus.pki is not None:
        rig = rig.secured(Path(own.bus.pki))
    ends = direct_endpoint(rig, "actuator", program(SUPERVISOR, ""))
    return trip_at(ends, rig.rig.name, trip, SUPERVISOR)


def serve_alone(bus: ZenohBus, rig: str, stop: threading.Event) -> None:
    """Hold the supervisor's token of a rig; raises BusError if another supervisor does not release
    it.
    """
    until_s = monotonic() + GONE_S
    while _may_be_served(bus, until_s):
        if monotonic() > until_s or stop.wait(LOOK_S):
            raise BusError(
                f"another supervisor already serves rig {rig}, perhaps at another port: stop "
                "it first, or use it; two supervisors would conflict"
            )
    bus.announce(SUPERVISOR)


def _may_be_served(bus: ZenohBus, until_s: float) -> bool:
    """Return whether another supervisor may serve the rig: its token is visible, or the router does
    not reply. Raises BusError if the router does not reply after ``until_s``.
    """
    try:
        return SUPERVISOR in bus.alive()
    except BusError:
        if monotonic() > until_s:
            raise
        return True


def interrupted(store: Store) -> list[str]:
    """Mark the jobs of an earlier supervisor as interrupted; return their names.

    If the journal cannot be written, for example on a full disk, the jobs of each served rig are
    marked later: a supervisor that did not start could not stop anything.
    """
    try:
        return store.interrupt_unfinished(utc_now())
    except StoreError as error:
        log.error("%s", error)
        return store.unfinished()


def _by_rig(store: Store, jobs: list[str]) -> dict[str, list[str]]:
    """Return job names by rig, in the same order."""
    found: dict[str, list[str]] = {}
    for name in jobs:
        row = store.get(name)
        if row is not None:
            found.setdefault(row.rig, []).append(name)
    return found


@contextmanager
def rest_server(
    listener: socket.socket, app: FastAPI, tls: ssl.SSLContext | None, stop: threading.Event
) -> Generator[None]:
    """Serve in a separate thread, which leaves signals to the program's start-up."""
    server = server_of(app, tls)

    def serve() -> None:
        server.run([listener])
        if not server.should_exit:
            raise RuntimeError("the REST server stopped unexpectedly")

    thread = threading.Thread(target=serve, name="rest")
    thread.start()
    try:
        while thread.is_alive() and not server.started:
            stop.wait(0.02)
        yield
    finally:
        server.should_exit = True
        thread.join(STOP_S)


UNHEARD_S = 30.0
"""Time without one of its own messages on the bus after which the supervisor restarts, in s."""
UNHEARD_LOOK_S = 1.0
UNHEARD_CAUSE = "supervisor.unheard"
RESTARTS = "PINCETTE_UNHEARD_RESTARTS"
"""Environment variable with the number of restarts since the last message was received."""
MOST_DOUBLED = 4
"""Largest number of doublings of ``UNHEARD_S``, once for each restart; on a silent bus the
supervisor then restarts every 8 minutes.
"""


class LoopbackWatch:
    """Checks whether the supervisor receives its own messages, and restarts it otherwise.

    It restarts only if a new session can be opened: without a router, or with one that hangs, a new
    process could not start either, and the stop by the direct link would be lost.
    """

    def __init__(
        self,
        hears: Callable[[], bool],
        can_join: Callable[[], bool],
        restart: Callable[[float], None],
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._hears, self._can_join, self._restart = hears, can_join, restart
        self._clock = clock
        self._received_at_s = clock()
        # A request on a bus that delivers nothing may never return, so the check has its own
        # thread.
        self._asking = RepeatedAction("unheard-asks", UNHEARD_LOOK_S, self.ask)
        self._looking = RepeatedAction("unheard", UNHEARD_LOOK_S, self.look)

    def start(self) -> None:
        """Start the checks in a thread."""
        self._received_at_s = self._clock()
        self._asking.start()
        self._looking.start()

    def ask(self) -> None:
        """Check whether the bus delivers the supervisor's own token."""
        if self._hears():
            self._received_at_s = self._clock()
            os.environ.pop(RESTARTS, None)

    def look(self) -> None:
        """Restart the supervisor if it has received nothing for too long and can join again."""
        silent_s = self._clock() - self._received_at_s
        if silent_s > UNHEARD_S * 2 ** min(_restarts(), MOST_DOUBLED) and self._can_join():
            self._restart(silent_s)

    def close(self) -> None:
        """Stop the checks, without waiting for a pending request."""
        self._looking.close(0.0)
        self._asking.close(0.0)


def _hears_itself(bus: ZenohBus) -> bool:
    """Return whether the supervisor's own token is visible at the router."""
    try:
        return SUPERVISOR in bus.alive()
    except BusError:
        return False


def can_join(open_bus: OpenBus) -> bool:
    """Return whether a new session can be opened at the router."""
    try:
        open_bus().close()
    except BusError:
        return False
    return True


def restart(context: RigContext, silent_s: float) -> None:
    """Replace this process by a new one, with an alarm in the journal.

    While the journal's disk hangs, this does nothing: a process whose threads wait for a disk
    cannot end, and the new one could not open its journal.
    """
    words = (
        f"the supervisor has not received its own messages on the bus for {silent_s:.0f} s, "
        f"limit {UNHEARD_S:g} s, although the router accepts connections: it restarts "
        "itself; the loop continues and a held part stays held"
    )
    context.alarms.raise_alarm(UNHEARD_CAUSE, words, severity="alarm", clears="acknowledge")
    if context.write_queue.late:
        return
    log.critical("%s", words)
    for handler in logging.getLogger().handlers:
        handler.flush()
    os.environ[RESTARTS] = str(_restarts() + 1)
    # The replacement closes all other descriptors, including the links that deliver nothing.
    os.execv(sys.executable, sys.orig_argv)


def _restarts() -> int:
    text = os.environ.get(RESTARTS, "")
    return int(text) if text.isdecimal() else 0
