"""``pincette doctor``: what is missing for a rig, and how to get it; needs of the machine."""

import logging
import os
import re
import shutil
import sys
from collections import defaultdict
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Annotated, Any, cast
from urllib.parse import urlsplit

import httpx
from rich.console import Console
from typer import Option

from pincette.cli import CliError, Exit, opened
from pincette.cli.doctor_rig import COLOURS, Finding, certificates, noted, rig_findings
from pincette.cli.drivers import (
    INSTRUMENTS_HELP,
    MOVE_STEPS,
    MOVE_V,
    STEP_S,
    direction,
    instruments,
    opened_device,
)
from pincette.cli.options import DATA, DataFolder
from pincette.cli.terminal import Json, RigOption, command, emit, group, screen
from pincette.config import RigFile
from pincette.core.service import member_services
from pincette.core.topics import LOOP
from pincette.engine.fleet import FleetError, check_ports
from pincette.engine.measuring.kept import changes_of, how, kept, words
from pincette.engine.process import loop_services
from pincette.engine.realtime.os_scheduling import FIFO, FIRST, trial
from pincette.engine.realtime.system import Linux
from pincette.instruments.protocols import InstrumentError, PositionSensor, VoltageOutput

FREE_MIB = 200
ASK_S = 2.0
PORTS_FREE = Finding(True, "ports: free")
Consent = Callable[[str], bool]


def machine(data: Path) -> Iterator[Finding]:
    """Python, packages, disk and priority."""
    python = ".".join(str(part) for part in sys.version_info[:3])
    yield Finding(sys.version_info >= (3, 11), f"Python {python}", "install Python 3.11 or newer")
    yield from packages(requires("pincette") or [])
    yield disk(data)
    if sys.platform == "linux":
        yield priority()


def packages(requirements: list[str]) -> Iterator[Finding]:
    """What pincette needs at work, each with its version."""
    for requirement in requirements:
        if "extra" in requirement:
            continue
        name = re.split(r"[^A-Za-z0-9._-]", requirement, maxsplit=1)[0]
        try:
            yield Finding(True, f"{name} {version(name)}")
        except PackageNotFoundError:
            remedy = "pip install --require-hashes -r requirements/dev.txt, or `make clean up`"
            yield Finding(False, requirement, remedy)


def disk(data: Path) -> Finding:
    """Room where records go."""
    folder = next(place for place in (data.absolute(), *data.absolute().parents) if place.exists())
    free = shutil.disk_usage(folder).free // 2**20
    return Finding(
        free >= FREE_MIB,
        f"{free} MiB free for records in {folder}, {FREE_MIB} MiB needed",
        "free some space, or choose another folder with --data",
    )


def priority() -> Finding:
    """Whether the loop gets the fixed priority that it asks for in real time, or what instead."""
    # On Linux a thread has a priority of its own, and this one ends with it.
    with ThreadPoolExecutor(1) as pool:
        got = pool.submit(_granted).result()
    fixed = f"fixed priority (SCHED_FIFO {FIFO}) permitted"
    if got == "fixed":
        return Finding(True, f"priority: {fixed}: yes")
    instead = f"niceness {FIRST}" if got == "niceness" else "normal priority"
    return noted(
        f"priority: {fixed}: no; the loop gets {instead}, and a busy machine delays its ticks",
        f"permit it: `rtprio {FIFO}` in limits.d, LimitRTPRIO={FIFO} in systemd, or ulimits in "
        "compose; docs/how-to/real-time.md says how",
    )


def _granted() -> str:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO))
    except OSError:
        try:
            os.setpriority(os.PRIO_PROCESS, 0, FIRST)
        except OSError:
            return ""
        return "niceness"
    return "fixed"


def os_requests(rig: RigFile) -> Iterator[Finding]:
    """What else the rig file's programs ask of the system, and do not get."""
    if sys.platform != "linux" or rig.lockstep:
        return
    for name in rig.programs:
        for one in trial(rig.realtime.of(*member_services(name)), Linux()):
            what = f"[realtime] {name} runs without {one.words}"
            needed = one.setting in rig.realtime.required
            yield Finding(False, what, one.remedy) if needed else noted(what, one.remedy)


def measured(rig: RigFile, data: Path) -> Iterator[Finding]:
    """What this machine keeps, where it was measured, and what in the rig file does not suit it."""
    if rig.lockstep:
        return
    known = kept(data)
    if known is None:
        yield noted("machine: what it keeps is not known", how(rig))
        return
    yield Finding(True, f"machine: {words(rig, known)}")
    for change in changes_of(rig, known):
        yield noted(f"machine: {change.key} does not suit it", change.words())


def shared_ports(rig: RigFile) -> Iterator[Finding]:
    """Ports and lines that the rig file gives to two of its parts."""
    users: dict[str, list[str]] = defaultdict(list)
    for offset, name in enumerate(LOOP, 1):
        users[str(rig.bus.port + offset)].append(name)
    if not rig.joins:
        users[str(rig.bus.port)].append("the router")
    if not (rig.joins or rig.bus.apart):
        users[str(rig.supervisor.port)].append("the supervisor")
    for name, url in (("the sensor", rig.sensor.url), ("the output", rig.output.url)):
        place = urlsplit(url)
        if place.scheme == "grpc":
            continue  # both are channels of one device
        local = rig.simulation is not None and place.scheme == "socket"
        users[str(place.port) if local else url].append(name)
    for place, names in users.items():
        if len(names) > 1:
            yield Finding(
                False,
                f"ports: {place} is given to {' and '.join(names)}",
                "give each a port of its own in the rig file; the programs of the loop take the "
                f"{len(LOOP)} after [bus] port",
            )


def port_finding(rig: RigFile) -> Finding:
    """Ports of a rig: free, in use because it is up, or taken by something else."""
    try:
        check_ports(rig)
    except FleetError as error:
        url = f"http://{rig.supervisor.host}:{rig.supervisor.port}"
        there = _version(url)
        if there.get("rig_file_digest") == rig.digest():
            return Finding(True, f"ports: in use by this very rig, which is up at {url}")
        if "rig" in there:
            what = f"ports: rig {there['rig']!r} is up at {url} with another rig file"
            return Finding(False, what, "end it, or give this rig other ports in its file")
        return Finding(False, f"ports: {error}", "`ss -ltnp` shows what uses the port")
    return PORTS_FREE


def _version(url: str) -> dict[str, Any]:
    """Version document of a supervisor; empty if none answers."""
    try:
        answer: Any = httpx.get(f"{url}/version", timeout=ASK_S, trust_env=False).json()
    except (httpx.HTTPError, ValueError):
        return {}
    return cast("dict[str, Any]", answer) if isinstance(answer, dict) else {}


app = group()


@command(app, "doctor")
def doctor(
    rig: RigOption,
    form: Json,
    data: DataFolder = DATA,
    move: Annotated[
        bool,
        Option("--move", help="ask, then move the arm a little: which way does it go"),
    ] = False,
) -> int:
    """Check everything; the exit status is 1 if something is missing."""
    found: list[Finding] = []
    console = screen()
    with _findings_alone():
        for finding in findings(rig.path, data, consent if move else None):
            found.append(finding)
            if not form.json:
                _show(finding, console)
    if form.json:
        emit([{**asdict(finding), "mark": finding.mark} for finding in found])
    return Exit.FAILED if any(finding.mark == "missing" for finding in found) else Exit.DONE


@contextmanager
def _findings_alone() -> Generator[None]:
    """Print no warnings of drivers: the findings say the same, once."""
    handler = logging.NullHandler()
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)


def _show(finding: Finding, console: Console) -> None:
    mark = finding.mark
    console.print(f"[{COLOURS[mark]}]{mark:<7}[/{COLOURS[mark]}]", end=" ")
    console.print(finding.what, markup=False, soft_wrap=True)
    if finding.remedy and mark != "well":
        console.print(f"        what to do: {finding.remedy}", markup=False, soft_wrap=True)


def consent(question: str) -> bool:
    """Ask the person at the terminal; no other word than y or yes is one."""
    print(question, end="", flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def findings(rig_path: Path, data: Path, consent: Consent | None = None) -> Iterator[Finding]:
    """Machine, rig file, ports, instruments, and with a person's consent a small motion."""
    yield from machine(data)
    try:
        rig = opened(rig_path)
    except CliError as error:
        yield Finding(False, str(error), "mend what is named, or name another with --rig")
        return
    yield Finding(True, f"rig file {rig_path}: rig {rig.rig.name!r}, digest {rig.digest()}")
    yield from rig_findings(rig)
    yield from os_requests(rig)
    yield from measured(rig, data)
    yield from shared_ports(rig)
    yield from certificates(rig)
    ports = port_finding(rig)
    yield ports
    if rig.simulation is not None:
        yield Finding(True, INSTRUMENTS_HELP)
        if consent is not None:
            yield Finding(False, "direction: simulated", "leave --move to a rig that is real")
    elif ports is PORTS_FREE:
        opened_instruments = list(instruments(rig))
        yield from opened_instruments
        if consent is not None and all(finding.well for finding in opened_instruments):
            yield moved(rig, consent)
    else:
        yield Finding(True, "instruments: not asked, since a rig is up")
        if consent is not None:
            yield Finding(False, "direction: a rig is up, which moves the arm", "end it first")


def moved(rig: RigFile, consent: Consent) -> Finding:
    """Ask a person, then find the direction of the motion."""
    question = (
        f"The output will be raised by {MOVE_V:g} V within "
        f"{MOVE_STEPS * STEP_S:g} s and brought back; the arm moves by some µm. Nothing must be "
        "in its way. Go on? [y/n] "
    )
    if not consent(question):
        what = "direction: not looked at, since nobody agreed to a motion"
        return Finding(False, what, "answer y at a terminal, once the arm's way is clear")
    services = loop_services()
    sensor = opened_device(services["sensor"], rig)
    if isinstance(sensor, Finding):
        return sensor
    with closing(sensor):
        output = opened_device(services["actuator"], rig)
        if isinstance(output, Finding):
            return output
        with closing(output):
            try:
                return direction(rig, cast(PositionSensor, sensor), cast(VoltageOutput, output))
            except InstrumentError as error:
                return Finding(False, f"direction: {error}", "see what the instrument shows")
