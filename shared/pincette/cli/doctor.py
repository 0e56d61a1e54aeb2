"""``pincette doctor``: checks the requirements of a rig, and lists drivers, laws and topics."""

import logging
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from typer import Option

from pincette.cli import CliError, Exit, opened
from pincette.cli.options import DATA, DataFolder
from pincette.cli.terminal import Json, RigOption, command, emit, group, screen
from pincette.diagnostics import Mark

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.config import RigFile
    from pincette.diagnostics import Finding


COLOURS: dict[Mark, str] = {"ok": "green", "missing": "red", "note": "yellow"}
Consent = Callable[[str], bool]


app = group()


@command(app, "doctor")
def doctor(
    rig: RigOption,
    form: Json,
    data: DataFolder = DATA,
    move: Annotated[
        bool,
        Option("--move", help="ask, then move the arm a little to find its direction"),
    ] = False,
    drivers: Annotated[
        bool,
        Option(
            "--drivers",
            help="check nothing: list the drivers and laws that a rig file can name, and why one "
            "cannot be used",
        ),
    ] = False,
    topics: Annotated[
        bool,
        Option(
            "--topics",
            help="check nothing: list the bus keys of a rig and the messages sent over them",
        ),
    ] = False,
) -> int:
    """Check everything; the exit status is 1 if a requirement is not met."""
    if drivers or topics:
        from pincette.cli import catalogue

        if drivers:
            catalogue.show_drivers(form)
        if topics:
            catalogue.show_topics(form, opened(rig.path).rig.name)
        return Exit.DONE
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
    """Suppress warnings of drivers; the findings already contain them."""
    handler = logging.NullHandler()
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)


def _show(finding: "Finding", console: "Console") -> None:
    from rich.text import Text

    mark = finding.mark
    console.print(Text.assemble((f"{mark:<7} ", COLOURS[mark]), finding.what))
    if finding.remedy and mark != "ok":
        console.print(f"        what to do: {finding.remedy}", markup=False)


def consent(question: str) -> bool:
    """Ask the person at the terminal; only y or yes counts as consent."""
    print(question, end="", flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def findings(rig_path: Path, data: Path, consent: Consent | None = None) -> "Iterator[Finding]":
    """Return the findings about machine, rig file, ports, instruments and, if a person consents, a
    small motion.
    """
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
        yield Finding(False, str(error), "correct what is named, or name another file with --rig")
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
        if consent is not None and all(finding.ok for finding in opened_instruments):
            yield moved(rig, consent)
    else:
        yield Finding(True, "instruments: not checked, since the rig is running")
        if consent is not None:
            yield Finding(
                False,
                "direction: not checked, since the rig is running and moves the arm",
                "stop it first",
            )


def moved(rig: "RigFile", consent: Consent) -> "Finding":
    """Ask a person for consent, then determine the direction of the motion."""
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
        f"The output will be raised by {MOVE_V:g} V within {MOVE_STEPS * STEP_S:g} s and "
        "brought back; the arm moves by some µm. Nothing must be in its way. Continue? "
        "[y/n] "
    )
    if not consent(question):
        what = "direction: not checked, since the motion was not confirmed"
        return Finding(False, what, "answer y at a terminal, once nothing is in the arm's way")
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
                return Finding(
                    False, f"direction: {error}", "look at the display of the instrument"
                )
