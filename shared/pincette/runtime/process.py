"""One program as one process: start, say that it is ready, stop cleanly, fail with a reason."""

import gc
import logging
import os
import secrets
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pincette import plugins
from pincette.bus.places import program_place, service_place
from pincette.bus.protocol import BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import ConfigError, RigFile, read_rig
from pincette.instruments.protocols import InstrumentError
from pincette.runtime.context import Context
from pincette.runtime.devices import open_device
from pincette.runtime.loop import ServiceLoop
from pincette.runtime.node import Node
from pincette.runtime.partners import wait_for_partners
from pincette.runtime.priority import come_first
from pincette.runtime.rig_file import serve_rig_file
from pincette.security.identity import SecurityError
from pincette.service import AnyService
from pincette.sim.wires.ports import WireError
from pincette.topics import ASKED, LOOP

log = logging.getLogger("pincette")
READY = "ready: "
"""How a line on standard output begins that says a program serves."""
OF_THE_ROUTER = ("router", "supervisor")
"""Programs that all rigs on one router share."""

CannotStart = (
    ConfigError,
    BusError,
    InstrumentError,
    WireError,
    plugins.PluginError,
    SecurityError,
    OSError,
)


@dataclass(frozen=True)
class Options:
    """How a program is started, beside its rig file."""

    data: Path = Path("data")
    leash: bool = False
    """End when standard input closes, so that nothing outlives whoever started it."""
    delay_s: float = 0.0
    """Longest random delay before a service publishes; for tests of determinism."""
    delay_seed: int = 0
    pki: Path | None = None
    """Folder of certificates; None: as the rig file says."""


def programs() -> list[str]:
    """Everything that `pincette run` can start."""
    return [*LOOP, *plugins.names(plugins.PROGRAMS)]


def run_program(name: str, rig_path: Path, options: Options) -> int:
    """Run one program until it is told to stop; returns the exit status."""
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format=f"%(asctime)s {name} %(message)s"
    )
    stop = threading.Event()
    try:
        rig = read_rig(rig_path)
        if options.pki is not None:
            rig = rig.secured(options.pki)
        if name in LOOP:
            _run_service(name, rig, stop, options)
        else:
            _run_other(name, rig, stop, options)
    except CannotStart as error:
        log.error("%s", error)
        return 2
    return 0


def _on_stop(stop: Callable[[], None], options: Options) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: stop())
    if options.leash:
        threading.Thread(target=_hold_leash, args=(stop,), daemon=True).start()


def _hold_leash(stop: Callable[[], None]) -> None:
    while os.read(0, 64):
        pass
    stop()


def _say_ready(text: str) -> None:
    sys.stdout.write(f"{READY}{text}\n")
    sys.stdout.flush()


def loop_services() -> dict[str, AnyService]:
    """The services of the loop, in the order of a tick."""
    return {name: plugins.load(plugins.SERVICES, name) for name in LOOP}


def _run_service(name: str, rig: RigFile, stop: threading.Event, options: Options) -> None:
    if not rig.lockstep:  # which keeps no clock, and would take the whole machine
        come_first()
    services = loop_services()
    service = services[name]
    node = Node(service, rig, open_device(service, rig), secrets.randbits(48))
    try:
        ends = service_place(rig, name, services)
        bus = ZenohBus(ends, rig.rig.name, name, reliable=rig.lockstep)
        try:
            loop = ServiceLoop(node, bus, options.delay_s, options.delay_seed)
            for topic in (*service.outputs, ASKED):
                bus.declare(topic)
            serve_rig_file(bus, rig, name)
            bus.announce(name)

            def end() -> None:
                stop.set()
                loop.stop()

            _on_stop(end, options)
            if wait_for_partners(name, rig, bus, ends, services, stop):
                gc.collect()
                gc.freeze()
                _say_ready(f"serves at {ends.listen[0]}")
                loop.run()
        finally:
            bus.close()
    finally:
        node.close()


def _run_other(name: str, file: RigFile, stop: threading.Event, options: Options) -> None:
    if file.joins and name in OF_THE_ROUTER:
        raise ConfigError(
            f"rig {file.rig.name!r} joins the router at {file.bus.router}, beside which its {name} "
            f"runs: start the {name} of the rig that has the router"
        )
    program: Callable[[Context], None] = plugins.load(plugins.PROGRAMS, name)

    def open_bus(rig: str | None = None, *, lockstep: bool | None = None) -> ZenohBus:
        patient = file.lockstep if lockstep is None else lockstep
        ends = program_place(file, name, lockstep=patient)
        return ZenohBus(ends, rig or file.rig.name, name)

    _on_stop(stop.set, options)
    home = file.home(options.data)
    program(Context(rig=file, data=home, open_bus=open_bus, ready=_say_ready, stop=stop))
