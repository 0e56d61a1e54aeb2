"""``pincette doctor`` and ``drivers``: what is missing for a rig, and what a rig file can name."""

import json
import logging
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, cast

from typer import Option

from pincette.cli import CliError, Exit, opened
from pincette.cli.options import DATA, DataFolder
from pincette.cli.terminal import Json, RigOption, command, emit, group, screen
from pincette.core import plugins
from pincette.diagnostics import Mark

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo
    from rich.console import Console

    from pincette.config import RigFile
    from pincette.diagnostics import Finding


COLOURS: dict[Mark, str] = {"well": "green", "missing": "red", "note": "yellow"}
Consent = Callable[[str], bool]


TABLES = {plugins.POSITION_SENSORS: "sensor", plugins.VOLTAGE_OUTPUTS: "output"}
"""The table of the rig file that names a driver of the group."""
MET = {True: "has met its instrument", False: "has not met its instrument"}
UNSAID = "does not say whether it has met its instrument"

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


def _show(finding: "Finding", console: "Console") -> None:
    mark = finding.mark
    console.print(f"[{COLOURS[mark]}]{mark:<7}[/{COLOURS[mark]}]", end=" ")
    console.print(finding.what, markup=False, soft_wrap=True)
    if finding.remedy and mark != "well":
        console.print(f"        what to do: {finding.remedy}", markup=False, soft_wrap=True)


def consent(question: str) -> bool:
    """Ask the person at the terminal; no other word than y or yes is one."""
    print(question, end="", flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def findings(rig_path: Path, data: Path, consent: Consent | None = None) -> "Iterator[Finding]":
    """Machine, rig file, ports, instruments, and with a person's consent a small motion."""
    from pincette.diagnostics import Finding
    from pincette.diagnostics.bus import exchanges, foreign_sessions
    from pincette.diagnostics.certificates import certificates
    from pincette.diagnostics.instruments import INSTRUMENTS_HELP, instruments
    from pincette.diagnostics.machine import (
        PORTS_FREE,
        machine,
        measured,
        os_requests,
        port_finding,
        shared_ports,
    )
    from pincette.diagnostics.rig_file import rig_findings

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
    if ports is not PORTS_FREE:
        yield from foreign_sessions(rig)
        yield from exchanges(rig)
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


def moved(rig: "RigFile", consent: Consent) -> "Finding":
    """Ask a person, then find the direction of the motion."""
    from pincette.diagnostics import Finding
    from pincette.diagnostics.instruments import (
        MOVE_STEPS,
        MOVE_V,
        STEP_S,
        direction,
        opened_device,
    )
    from pincette.engine.process import loop_services
    from pincette.instruments.protocols import InstrumentError, PositionSensor, VoltageOutput

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


@dataclass(frozen=True, slots=True)
class Driver:
    """What is known of a driver."""

    name: str
    origin: str
    """Distribution and version."""
    met: bool | None = None
    """Whether it has met its instrument; None where it does not say."""
    options: tuple[str, ...] = ()
    """Each with its default, as a rig file writes it."""
    fault: str = ""
    """Why it cannot be had; empty where it can."""


@command(app, "drivers")
def drivers(form: Json) -> None:
    """List the drivers and laws that a rig file can name, and why one cannot be used."""
    from pincette.api.plans import InstalledLaw
    from pincette.config.laws import laws_by_name

    if form.json:
        found = {kind: [asdict(one) for one in installed(name)] for name, kind in TABLES.items()}
        laws = [InstalledLaw.of(law).model_dump() for law in laws_by_name().values()]
        emit({**found, "laws": laws})
        return
    for name, kind in plugins.DRIVERS.items():
        print(f"{kind}s, for `driver` in [{TABLES[name]}]:")
        for driver in installed(name):
            print("\n".join(f"  {line}" for line in _lines(driver)))
    print("control laws, for `scheme` in [law]:")
    for entry in plugins.registered(plugins.LAWS):
        print("\n".join(f"  {line}" for line in _law_lines(entry)))


def _law_lines(entry: EntryPoint) -> Iterator[str]:
    from pincette.config.laws import law_definition, laws_by_name

    yield f"{entry.name}, from {plugins.origin(entry)}"
    law = laws_by_name().get(entry.name)
    if law is None:
        try:
            law = law_definition(entry.name)
        except ValueError as error:
            yield f"    cannot be used: {error}"
            return
    if law.arms > 1:
        yield f"    of rigs with {law.arms} driven arms, which need not name it"
    yield f"    {law.title}: {law.summary}"
    gains = (f"{gain.name} = {gain.default:g} {gain.unit}".rstrip() for gain in law.parameters)
    yield f"    gains: {', '.join(gains)}"


def installed(group: str) -> list[Driver]:
    """Every driver registered in a group, by name."""
    return [_described(group, entry) for entry in plugins.registered(group)]


def _described(group: str, entry: EntryPoint) -> Driver:
    origin = plugins.origin(entry)
    try:
        plugins.load(group, entry.name)
    except plugins.PluginError as error:
        return Driver(entry.name, origin, fault=str(error))
    module = sys.modules[entry.module]
    met = vars(module).get("MET")
    options = tuple(_options(module))
    return Driver(entry.name, origin, met if isinstance(met, bool) else None, options)


def _options(module: ModuleType) -> Iterator[str]:
    """The fields of the table of options, which is a class of the module named …Options."""
    from pincette.config import Table

    for name, thing in vars(module).items():
        own = isinstance(thing, type) and thing.__module__ == module.__name__
        if own and issubclass(thing, Table) and name.endswith("Options"):
            for option, field in thing.model_fields.items():
                yield f"{option} {_default(field)}"


def _default(field: "FieldInfo") -> str:
    if field.is_required():
        return "(must be given)"
    if field.default_factory is not None:
        return "(set when it is opened)"
    return f"= {json.dumps(field.default, ensure_ascii=False, default=str)}"


def _lines(driver: Driver) -> Iterator[str]:
    yield f"{driver.name}, from {driver.origin}"
    if driver.fault:
        yield f"    cannot be used: {driver.fault}"
        return
    yield f"    {UNSAID if driver.met is None else MET[driver.met]}"
    yield f"    options: {', '.join(driver.options) or 'none'}"
