"""`pincette doctor`: what is missing for a rig, and how to get it."""

import sys
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from pincette.cli.doctor_finding import COLOURS, Finding
from pincette.cli.doctor_instruments import WOULD, Consent, instruments, moved
from pincette.cli.doctor_machine import machine, port_finding, shared_places, wishes
from pincette.cli.doctor_rig import rig_findings
from pincette.cli.rest import CliError
from pincette.cli.rig_file import opened
from pincette.cli.security_findings import certificates


def doctor(rig_path: Path, data: Path, *, move: bool = False) -> int:
    """Look at everything; the exit status is 1 where something is missing."""
    console = Console(highlight=False)
    worst = 0
    for finding in findings(rig_path, data, consent if move else None):
        mark = finding.mark
        console.print(f"[{COLOURS[mark]}]{mark:<7}[/{COLOURS[mark]}]", end=" ")
        console.print(finding.what, markup=False, soft_wrap=True)
        if finding.remedy and mark != "well":
            console.print(f"        what to do: {finding.remedy}", markup=False, soft_wrap=True)
        worst = max(worst, int(mark == "missing"))
    return worst


def consent(question: str) -> bool:
    """Ask the person at the terminal; no other word than yes is one."""
    print(question, end="", flush=True)
    return sys.stdin.readline().strip().lower() == "yes"


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
    yield from wishes(rig)
    yield from shared_places(rig)
    yield from certificates(rig)
    ports = port_finding(rig)
    yield ports
    if rig.simulation is not None:
        yield Finding(True, WOULD)
        if consent is not None:
            yield Finding(False, "direction: simulated", "leave --move to a rig that is real")
    elif ports.well and ports.what.startswith("ports: free"):
        asked = list(instruments(rig))
        yield from asked
        if consent is not None and all(finding.well for finding in asked):
            yield moved(rig, consent)
    else:
        yield Finding(True, "instruments: not asked, since a rig is up")
        if consent is not None:
            yield Finding(False, "direction: a rig is up, which moves the arm", "end it first")
