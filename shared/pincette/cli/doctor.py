"""`pincette doctor`: what is missing for a rig, and how to get it."""

import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any, cast

import httpx
from rich.console import Console

from pincette import plugins
from pincette.cli.rest import CliError
from pincette.cli.rig_file import opened
from pincette.config import ConfigError, RigFile
from pincette.instruments.protocols import InstrumentError
from pincette.runtime.devices import open_device
from pincette.runtime.fleet import FleetError, check_ports
from pincette.runtime.process import loop_services
from pincette.service import AnyService

FREE_MIB = 200
ASK_S = 2.0


@dataclass(frozen=True)
class Finding:
    """One thing looked at: whether it is well, and what to do where it is not."""

    well: bool
    what: str
    remedy: str = ""


def doctor(rig_path: Path, data: Path) -> int:
    """Look at everything; the exit status is 1 where something is missing."""
    console = Console(highlight=False)
    worst = 0
    for finding in findings(rig_path, data):
        mark = "[green]well   [/green]" if finding.well else "[red]missing[/red]"
        console.print(mark, end=" ")
        console.print(finding.what, markup=False, soft_wrap=True)
        if not finding.well:
            worst = 1
            console.print(f"        what to do: {finding.remedy}", markup=False, soft_wrap=True)
    return worst


def findings(rig_path: Path, data: Path) -> Iterator[Finding]:
    """Python, packages, disk, rig file, ports, instruments."""
    python = ".".join(str(part) for part in sys.version_info[:3])
    yield Finding(sys.version_info >= (3, 11), f"Python {python}", "install Python 3.11 or newer")
    yield from packages(requires("pincette") or [])
    yield disk(data)
    try:
        rig = opened(rig_path)
    except CliError as error:
        yield Finding(False, str(error), "mend what is named, or name another with --rig")
        return
    yield Finding(True, f"rig file {rig_path}: rig {rig.rig.name!r}, digest {rig.digest()}")
    yield driver(plugins.POSITION_SENSORS, rig.sensor.driver)
    yield driver(plugins.VOLTAGE_OUTPUTS, rig.output.driver)
    ports = port_finding(rig)
    yield ports
    if rig.simulation is not None:
        yield Finding(True, "instruments: simulated, started with the rig")
    elif ports.well and ports.what.startswith("ports: free"):
        yield from _instruments(rig)
    else:
        yield Finding(True, "instruments: not asked, since a rig is up")


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


def driver(group: str, name: str) -> Finding:
    """Whether a driver is installed."""
    there = plugins.names(group)
    remedy = f"install it, or name another in the rig file; there are {', '.join(there)}"
    return Finding(name in there, f"driver {name}", remedy)


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


def _instruments(rig: RigFile) -> Iterator[Finding]:
    for service in loop_services().values():
        if service.instrument == "position_sensor":
            yield _reached(service, rig, f"position sensor at {rig.sensor.url}")
        elif service.instrument == "voltage_output":
            yield _reached(service, rig, f"voltage output at {rig.output.url}")


def _reached(service: AnyService, rig: RigFile, what: str) -> Finding:
    try:
        device = open_device(service, rig)
    except plugins.PluginError as error:
        return Finding(False, f"{service.name}: {error}", "install the driver, or name another")
    except ConfigError as error:
        return Finding(False, f"{service.name}: {error}", "mend the options in the rig file")
    except InstrumentError as error:
        remedy = "check cable, power, address, and the url in the rig file"
        return Finding(False, f"{service.name}: {error}", remedy)
    if device is not None:
        device.close()
    return Finding(True, what)
