"""One program as one process: start, report readiness, stop cleanly, fail with a reason."""

import logging
import os
import resource
import secrets
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from pincette.bus.endpoints import program_endpoint, service_endpoint
from pincette.bus.protocol import BusError
from pincette.bus.topology import awaited
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config import ConfigError, RigFile, read_rig
from pincette.core import plugins
from pincette.core.service import (
    AnyService,
    CompositeService,
    Participant,
    RefusedError,
    member_services,
)
from pincette.core.streams import drop
from pincette.core.topics import LOOP, REQUEST_LOG, TIMING
from pincette.engine import logs
from pincette.engine.boot_note import FIRST, BootNote, boot_note
from pincette.engine.instrument import open_device
from pincette.engine.loop import Loop
from pincette.engine.peers import wait_for_peers
from pincette.engine.program import Context
from pincette.engine.realtime.gc_tuning import disable_gc, freeze_gc
from pincette.engine.realtime.os_scheduling import raise_priority
from pincette.engine.rig_file import serve_rig_file
from pincette.engine.runner import Runner
from pincette.engine.threads import FailedThreads
from pincette.engine.timing_budget import shared_timeout_s
from pincette.instruments.line.counts import LineCounts, counting
from pincette.instruments.protocols import InstrumentError
from pincette.security.identity import SecurityError
from pincette.sim.wires.ports import WireError

log = logging.getLogger("pincette")
READY = "ready: "
"""Beginning of the line on standard output which reports that a program is ready."""
OF_THE_ROUTER = ("router", "upstream", "supervisor")
"""Programs that are shared by all rigs on one router."""

OTHERS = 0o077
MOST_FILES = 4096
"""Largest number of files that a program may have open; connections of unknown clients use far
fewer."""

FAILED = FailedThreads()
"""Threads of this process that ended with an error."""
Notes = dict[Runner, BootNote]
"""Boot notes of the services that depend on how their previous program ended."""

CannotStart = (
    ConfigError,
    BusError,
    InstrumentError,
    RefusedError,
    WireError,
    plugins.PluginError,
    SecurityError,
    OSError,
)


@dataclass(frozen=True)
class Options:
    """Options of a program's start, besides its rig file."""

    data: Path = Path("data")
    exit_with_parent: bool = False
    """True to end the program when standard input closes, so that it does not outlive its
    parent."""
    delay_s: float = 0.0
    """Longest random delay before a service publishes, in s; for tests of determinism."""
    delay_seed: int = 0
    pki: Path | None = None
    """Folder of certificates; None: as in the rig file."""
    listen: str | None = None
    """Address at which the router listens; None: as in the rig file."""
    log_format: logs.Form | None = None
    """Form of log lines; None: from the environment."""


def run_program(name: str, rig_path: Path, options: Options) -> int:
    """Run one program until it is stopped; return the exit status."""
    try:
        lines = logs.begin(name, logs.chosen(options.log_format))
    except ValueError as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 2
    _allow_files()
    keep_from_others()
    FAILED.names.clear()
    stop = threading.Event()
    try:
        rig = read_rig(rig_path)
        if lines is not None:
            lines.rig = rig.rig.name
        if options.pki is not None:
            rig = rig.secured(options.pki)
        if options.listen is not None:
            rig = rig.listening(options.listen)
        if member_services(name):
            _run_of_loop(name, rig, stop, options)
        else:
            _run_other(name, rig, stop, options)
    except CannotStart as error:
        log.error("%s", error)
        return 2
    return 1 if FAILED.names else 0


def _allow_files() -> None:
    """Raise the limit of open files as far as the system allows."""
    given, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_FILES if most == resource.RLIM_INFINITY else min(MOST_FILES, most)
    if given not in (resource.RLIM_INFINITY, max(given, wanted)):
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))


def keep_from_others() -> None:
    """Make files that are written from now on inaccessible to other accounts."""
    os.umask(os.umask(OTHERS) | OTHERS)


def _on_stop(stop: Callable[[], None], options: Options) -> None:
    FAILED.end_program(stop)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: stop())
    for number in (signal.SIGHUP, signal.SIGTTOU):  # a lost terminal must not release a held part
        signal.signal(number, signal.SIG_IGN)
    if options.exit_with_parent:
        threading.Thread(target=_wait_for_parent, args=(stop,), daemon=True).start()


def _wait_for_parent(stop: Callable[[], None]) -> None:
    while os.read(0, 64):
        pass
    stop()


def _say_ready(text: str) -> None:
    """Print that the program is ready, if standard output can be written."""
    try:
        sys.stdout.write(f"{READY}{text}\n")
        sys.stdout.flush()
    except (OSError, ValueError):
        drop(sys.stdout)


def loop_services() -> dict[str, AnyService]:
    """Return the services of the loop, in the order of a tick."""
    return {name: plugins.load(plugins.SERVICES, name) for name in LOOP}


def loop_programs(rig: RigFile) -> dict[str, Participant]:
    """Return the programs of a rig's loop with their inputs and requests, in the order of a
    tick.
    """
    services = loop_services()
    return {
        name: services[name]
        if name in services
        else CompositeService(name, tuple(services[one] for one in member_services(name)))
        for name in rig.programs
    }


def _run_of_loop(name: str, rig: RigFile, stop: threading.Event, options: Options) -> None:
    """Run a service of the loop, or several if the rig file composes them."""
    if name not in rig.programs:
        raise ConfigError(
            f"[rig] composed = {list(rig.rig.composed)}: the programs of the loop of rig "
            f"{rig.rig.name!r} are {', '.join(rig.programs)}, not {name}"
        )
    if not rig.lockstep:  # lockstep does not follow a clock, and would use the whole machine
        raise_priority(rig.realtime.of(*member_services(name)))
    participants = loop_programs(rig)
    with ExitStack() as stack:
        notes: Notes = {}
        runners = _opened(name, rig, options.data, notes, stack)
        config = service_endpoint(rig, name, participants)
        bus = ZenohBus(config, rig.rig.name, name)
        stack.callback(bus.close)
        urgent = awaited(name, participants, lockstep=rig.lockstep) if len(runners) > 1 else None
        loop = Loop(
            runners,
            bus,
            urgent=urgent,
            delay_s=options.delay_s,
            delay_seed=options.delay_seed,
            refused=bus.refused,
        )
        for topic in (topic for runner in runners for topic in runner.service.outputs):
            bus.declare(topic)
        for service in member_services(name):
            bus.declare(REQUEST_LOG, service)
            bus.declare(TIMING, service)
            serve_rig_file(bus, rig, service)
            bus.announce(service)

        def end() -> None:
            stop.set()
            loop.stop()

        _on_stop(end, options)
        if wait_for_peers(name, rig, bus, config, participants, stop):
            disable_gc()
            _say_ready(f"serves at {config.listen[0]}")
            for note in notes.values():
                note.begin()
            loop.run()
            for runner, note in notes.items():
                note.end(runner.ending, runner.instance)


def _opened(
    name: str, rig: RigFile, data: Path, notes: Notes, stack: ExitStack
) -> Sequence[Runner]:
    """Return the runners of a program with their instruments, which ``stack`` closes."""
    services = [plugins.load(plugins.SERVICES, one) for one in member_services(name)]
    at_most_s = shared_timeout_s(rig, services)
    runners: list[Runner] = []
    for service in services:
        counts = LineCounts()
        with counting(counts):
            device = open_device(service, rig, at_most_s)
        note = boot_note(rig, service.name, data) if service.ending is not None else None
        before = FIRST if note is None else note.found()
        instance = secrets.randbits(48)
        runner = Runner(service, rig, device, instance, before=before, line_counts=counts)
        runners.append(runner)
        stack.callback(runner.close)
        if note is not None:
            notes[runner] = note
    return runners


def _run_other(name: str, file: RigFile, stop: threading.Event, options: Options) -> None:
    if file.joins and name in OF_THE_ROUTER:
        raise ConfigError(
            f"rig {file.rig.name!r} joins the router of another rig at {file.bus.router} and "
            f"uses the {name} of that rig: start the {name} there"
        )
    program: Callable[[Context], None] = plugins.load(plugins.PROGRAMS, name)

    def open_bus(rig: str | None = None, *, lockstep: bool | None = None) -> ZenohBus:
        patient = file.lockstep if lockstep is None else lockstep
        config = program_endpoint(file, name, lockstep=patient)
        return ZenohBus(config, rig or file.rig.name, name)

    def ready(text: str) -> None:
        freeze_gc()
        _say_ready(text)

    _on_stop(stop.set, options)
    home = file.home(options.data)
    program(Context(rig=file, data=home, open_bus=open_bus, ready=ready, stop=stop))
