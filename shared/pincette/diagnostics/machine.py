"""Properties of this machine that matter for a rig: packages, disk, priority, timing, ports."""

import os
import re
import shutil
import sys
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any, cast
from urllib.parse import urlsplit

from pincette.config import RigFile
from pincette.core.service import member_services
from pincette.core.topics import LOOP
from pincette.diagnostics import Finding, noted
from pincette.engine.fleet import FleetError, check_ports
from pincette.engine.measuring.kept import changes_of, how, kept, words
from pincette.engine.realtime.os_scheduling import FIFO, FIRST, trial
from pincette.engine.realtime.system import Linux

FREE_MIB = 200
ASK_S = 2.0
PORTS_FREE = Finding(True, "ports: free")


def machine(data: Path) -> Iterator[Finding]:
    """Check Python, packages, disk and priority."""
    python = ".".join(str(part) for part in sys.version_info[:3])
    yield Finding(sys.version_info >= (3, 11), f"Python {python}", "install Python 3.11 or newer")
    yield from packages(requires("pincette") or [])
    yield disk(data)
    if sys.platform == "linux":
        yield priority()


def packages(requirements: list[str]) -> Iterator[Finding]:
    """Check the packages that pincette needs, each with its version."""
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
    """Check the disk space for records."""
    folder = next(place for place in (data.absolute(), *data.absolute().parents) if place.exists())
    free = shutil.disk_usage(folder).free // 2**20
    return Finding(
        free >= FREE_MIB,
        f"{free} MiB free for records in {folder}, {FREE_MIB} MiB needed",
        "free some space, or choose another folder with --data",
    )


def priority() -> Finding:
    """Check whether the loop gets the fixed priority that the rig file requests, or which one it
    gets.
    """
    # On Linux each thread has its own priority, which ends with this thread.
    with ThreadPoolExecutor(1) as pool:
        got = pool.submit(_granted).result()
    fixed = f"fixed priority (SCHED_FIFO {FIFO}) permitted"
    if got == "fixed":
        return Finding(True, f"priority: {fixed}: yes")
    instead = f"niceness {FIRST}" if got == "niceness" else "normal priority"
    return noted(
        f"priority: {fixed}: no; the loop gets {instead}, and a busy machine delays its ticks",
        f"permit it: `rtprio {FIFO}` in limits.d, LimitRTPRIO={FIFO} in systemd, or ulimits "
        "in compose; docs/how-to/real-time.md explains how",
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
    """Check which other settings of the rig file the system refuses."""
    if sys.platform != "linux" or rig.lockstep:
        return
    for name in rig.programs:
        for one in trial(rig.realtime.of(*member_services(name)), Linux()):
            what = f"[realtime] {name} runs without {one.words}"
            needed = one.setting in rig.realtime.required
            yield Finding(False, what, one.remedy) if needed else noted(what, one.remedy)


def measured(rig: RigFile, data: Path) -> Iterator[Finding]:
    """Compare the measured timing of this machine with the rig file."""
    if rig.lockstep:
        return
    known = kept(data)
    if known is None:
        yield noted("machine: its timing is not known", how(rig))
        return
    yield Finding(True, f"machine: {words(rig, known)}")
    for change in changes_of(rig, known):
        yield noted(f"machine: {change.key} does not suit this machine", change.words())


def shared_ports(rig: RigFile) -> Iterator[Finding]:
    """Check for ports and lines that the rig file assigns twice."""
    users: dict[str, list[str]] = defaultdict(list)
    for offset, name in enumerate(LOOP, 1):
        users[str(rig.bus.port + offset)].append(name)
    if not rig.joins:
        users[str(rig.bus.port)].append("the router")
    if not (rig.joins or rig.bus.served_upstream):
        users[str(rig.supervisor.port)].append("the supervisor")
    instruments = [("the sensor", rig.sensor.url), ("the output", rig.output.url)]
    if rig.second is not None:
        instruments.append(("the second arm's sensor", rig.second.sensor.url))
        instruments.append(("the second arm's output", rig.second.output.url))
    for name, url in instruments:
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
                "give each a port of its own in the rig file; the programs of the loop use "
                f"the {len(LOOP)} ports after [bus] port",
            )


def port_finding(rig: RigFile) -> Finding:
    """Check the ports of a rig: free, in use by the running rig, or taken by another program."""
    try:
        check_ports(rig)
    except FleetError as error:
        url = rig.supervisor.url
        there = _version(url)
        if there.get("rig_file_digest") == rig.digest():
            return Finding(True, f"ports: in use by this rig itself, which is running at {url}")
        if "rig" in there:
            what = f"ports: rig {there['rig']!r} is running at {url} with another rig file"
            return Finding(False, what, "stop it, or give this rig other ports in its file")
        return Finding(False, f"ports: {error}", "`ss -ltnp` shows the program that uses the port")
    return PORTS_FREE


def _version(url: str) -> dict[str, Any]:
    """Return the version document of a supervisor; empty if none replies."""
    # Loaded only where a port is in use.
    import httpx

    try:
        # The sender need not be known: no data is sent, and the reply is only shown.
        answer: Any = httpx.get(
            f"{url}/version", timeout=ASK_S, trust_env=False, verify=False
        ).json()
    except (httpx.HTTPError, ValueError):
        return {}
    return cast("dict[str, Any]", answer) if isinstance(answer, dict) else {}
