"""What a rig needs of the machine: Python, packages, room, ports."""

import re
import shutil
import sys
from collections import defaultdict
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any, cast
from urllib.parse import urlsplit

import httpx

from pincette.cli.doctor_finding import Finding
from pincette.config import RigFile
from pincette.runtime.fleet import FleetError, check_ports
from pincette.topics import LOOP

FREE_MIB = 200
ASK_S = 2.0


def machine(data: Path) -> Iterator[Finding]:
    """Python, packages and disk."""
    python = ".".join(str(part) for part in sys.version_info[:3])
    yield Finding(sys.version_info >= (3, 11), f"Python {python}", "install Python 3.11 or newer")
    yield from packages(requires("pincette") or [])
    yield disk(data)


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


def shared_places(rig: RigFile) -> Iterator[Finding]:
    """Ports and lines that the rig file gives to two of its parts."""
    users: dict[str, list[str]] = defaultdict(list)
    for offset, name in enumerate(("the router", *LOOP)):
        users[str(rig.bus.port + offset)].append(name)
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
        there = _who(url)
        if there.get("rig_file_digest") == rig.digest():
            return Finding(True, f"ports: in use by this very rig, which is up at {url}")
        if "rig" in there:
            what = f"ports: rig {there['rig']!r} is up at {url} with another rig file"
            return Finding(False, what, "end it, or give this rig other ports in its file")
        return Finding(False, f"ports: {error}", "`ss -ltnp` shows what uses the port")
    return Finding(True, "ports: free")


def _who(url: str) -> dict[str, Any]:
    """What a supervisor says of itself; empty where none answers."""
    try:
        answer: Any = httpx.get(f"{url}/version", timeout=ASK_S, trust_env=False).json()
    except (httpx.HTTPError, ValueError):
        return {}
    return cast("dict[str, Any]", answer) if isinstance(answer, dict) else {}
