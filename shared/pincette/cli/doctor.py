"""`pincette doctor`: what is missing for a rig, and how to get it."""

import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from rich.console import Console

from pincette import plugins
from pincette.config import ConfigError, RigFile, read_rig
from pincette.instruments.protocols import InstrumentError
from pincette.runtime.devices import open_device
from pincette.runtime.fleet import FleetError, check_ports
from pincette.runtime.process import loop_services

FREE_MIB = 200


@dataclass(frozen=True)
class Finding:
    """One thing looked at: whether it is well, and what to do where it is not."""

    well: bool
    what: str
    remedy: str = ""


def doctor(rig_path: Path) -> int:
    """Look at everything; the exit status is 1 where something is missing."""
    console = Console(highlight=False, soft_wrap=True)
    worst = 0
    for finding in findings(rig_path):
        mark = "[green]well   [/green]" if finding.well else "[red]missing[/red]"
        console.print(f"{mark} {finding.what}")
        if not finding.well:
            worst = 1
            console.print(f"        {finding.remedy}")
    return worst


def findings(rig_path: Path) -> Iterator[Finding]:
    """Python, packages, disk, rig file, ports, instruments."""
    python = ".".join(str(part) for part in sys.version_info[:3])
    yield Finding(sys.version_info >= (3, 11), f"Python {python}", "install Python 3.11 or newer")
    yield from _packages()
    free = shutil.disk_usage(Path.cwd()).free // 2**20
    yield Finding(
        free >= FREE_MIB,
        f"{free} MiB free on disk, {FREE_MIB} MiB needed",
        "free some space, or choose another folder with --data",
    )
    try:
        rig = read_rig(rig_path)
    except ConfigError as error:
        yield Finding(False, str(error), "mend the file, or name another with --rig")
        return
    yield Finding(True, f"rig file {rig_path}: rig {rig.rig.name!r}, digest {rig.digest()}")
    yield _tried("ports", "end what uses them", lambda: check_ports(rig), FleetError)
    if rig.simulation is None:
        yield from _instruments(rig)
    else:
        yield Finding(True, "instruments: simulated, started with the rig")


def _packages() -> Iterator[Finding]:
    for requirement in requires("pincette") or ():
        if "extra" in requirement:
            continue
        name = requirement.split("=")[0].split(">")[0]
        try:
            yield Finding(True, f"{name} {version(name)}")
        except PackageNotFoundError:
            yield Finding(
                False, requirement, "pip install --require-hashes -r requirements/dev.txt"
            )


def _instruments(rig: RigFile) -> Iterator[Finding]:
    for service in loop_services().values():
        if service.instrument is None:
            continue
        settings = rig.sensor if service.instrument == "position_sensor" else rig.output

        def reach(service: object = service) -> None:
            device = open_device(loop_services()[getattr(service, "name", "")], rig)
            if device is not None:
                device.close()

        yield _tried(
            f"{settings.driver} at {settings.url}",
            "check cable, power, address and [sensor] or [output] url in the rig file",
            reach,
            (InstrumentError, plugins.PluginError),
        )


def _tried(
    what: str,
    remedy: str,
    action: Callable[[], None],
    errors: type[Exception] | tuple[type[Exception], ...],
) -> Finding:
    try:
        action()
    except errors as error:
        return Finding(False, f"{what}: {error}", remedy)
    return Finding(True, what)
