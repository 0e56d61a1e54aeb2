"""The word ``doctor``."""

import argparse
from dataclasses import asdict

from pincette.cli.doctor import consent, doctor, findings
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, does, machine, rigged
from pincette.cli.output import emit

ABOUT = "say what is missing for a rig, and how to get it"


def add(word: Words) -> None:
    """Add ``doctor``."""
    one = machine(rigged(word("doctor", ABOUT), data=True))
    one.add_argument(
        "--move", action="store_true", help="ask, then move the arm a little: which way does it go"
    )
    does(one, diagnose)


def diagnose(given: argparse.Namespace) -> int:
    """Look at everything; the exit status is 1 where something is missing."""
    if not given.json:
        return doctor(given.rig, given.data, move=given.move)
    found = list(findings(given.rig, given.data, consent if given.move else None))
    emit([{**asdict(finding), "mark": finding.mark} for finding in found])
    return Exit.DONE if all(finding.mark != "missing" for finding in found) else Exit.FAILED
