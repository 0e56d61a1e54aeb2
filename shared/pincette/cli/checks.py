"""``pincette checks``: everything that is looked at of a rig, each with its value and its limit."""

import argparse

from rich.markup import escape

from pincette.api.check_models import Check
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does
from pincette.cli.output import emit, screen
from pincette.cli.rest import rig_of
from pincette.cli.tables import table

ABOUT = "everything that is looked at of a rig: programs, ages, latch, disk, lease, model"
SHORT = 1000.0
"""From here on a value has no decimals."""


def add(word: Words) -> None:
    """Add ``checks``."""
    does(addressed(word("checks", ABOUT)), show)


def show(given: argparse.Namespace) -> int:
    """List the checks; the exit status is 1 where one that is needed fails."""
    checks = rig_of(given).state().checks
    if given.json:
        emit(checks)
    else:
        rows = table("check", "", "value", "limit", "in words", right=("value", "limit"))
        for one in checks:
            rows.add_row(
                one.name,
                mark(one),
                figure(one.value),
                figure(one.limit, one.unit),
                escape(one.words),
            )
        screen().print(rows)
    return Exit.DONE if all(one.ok or not one.needed for one in checks) else Exit.FAILED


def mark(one: Check) -> str:
    """Well, missing, or something for a person to see to."""
    if one.ok:
        return "[green]ok[/]"
    return "[red]fails[/]" if one.needed else "[yellow]look[/]"


def figure(value: float | str | None, unit: str = "") -> str:
    """A value as a person reads it."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    digits = f"{value:.0f}" if abs(value) >= SHORT else f"{value:.3g}"
    return f"{digits} {unit}".rstrip()
