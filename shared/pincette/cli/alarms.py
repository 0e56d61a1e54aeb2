"""``pincette alarms``: what an operator must learn, and what has become of it."""

import argparse

from rich.markup import escape

from pincette.api.alarm_models import Alarm, AlarmList
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does, words
from pincette.cli.output import emit, screen
from pincette.cli.rest import reached
from pincette.cli.tables import clock, table
from pincette.client import alarm_calls

ABOUT = "alarms of the rigs: list them, or acknowledge one; neither moves anything"
COLOURS = {"alarm": "red", "warning": "yellow"}
ENDS = {
    "reset": "until the rig is reset",
    "condition": "still so",
    "acknowledge": "",
}


def add(word: Words) -> None:
    """Add ``alarms`` with every word below it."""
    below = words(word("alarms", ABOUT), "what", "WHAT")
    one = below("list", "alarms that are open, the newest first")
    one.add_argument("--all", action="store_true", help="also those that are over and seen")
    one.add_argument("--limit", type=int, default=50, metavar="N", help="%(default)s if not given")
    one.add_argument("--before", type=int, metavar="ID", help="begin below this id")
    does(addressed(one), list_alarms)
    one = below("acknowledge", "say that you have seen an alarm, or all that are open")
    one.add_argument("ids", nargs="*", type=int, metavar="ID", help="all if none is given")
    does(addressed(one), acknowledge)


def _asked(given: argparse.Namespace, **more: str | float | None) -> AlarmList:
    query = {"rig": given.at, **more}
    wanted = {name: value for name, value in query.items() if value is not None}
    return reached(given).line.send(alarm_calls.alarms(wanted))


def list_alarms(given: argparse.Namespace) -> int:
    """List alarms, a line each."""
    only = None if given.all else "true"
    found = _asked(given, open=only, limit=given.limit, before=given.before)
    if given.json:
        emit(found)
        return Exit.DONE
    if not found.alarms:
        print("no alarm yet" if given.all else "no alarm is open; --all lists those of before")
        return Exit.DONE
    rows = table("id", "came", "rig", "what", "times", "state", right=("times",))
    for one in found.alarms:
        colour = COLOURS[one.severity] if one.open else "dim"
        rows.add_row(
            str(one.id),
            clock(one.last_at),
            one.rig,
            f"[{colour}]{escape(one.words)}[/]",
            str(one.count),
            state(one),
        )
    console = screen()
    console.print(rows)
    if found.next is not None:
        console.print(f"older ones: --before {found.next}")
    return Exit.DONE


def acknowledge(given: argparse.Namespace) -> int:
    """Acknowledge alarms."""
    wanted: list[int] = given.ids
    if not wanted:
        found = _asked(given, open="true", limit=500).alarms
        wanted = [one.id for one in found if one.acknowledged_at is None]
    line = reached(given).line
    seen = [line.send(alarm_calls.acknowledge(number)) for number in wanted]
    if given.json:
        emit(seen)
        return Exit.DONE
    for one in seen:
        print(f"alarm {one.id}: {state(one)}")
    if not seen:
        print("no alarm waits to be acknowledged")
    return Exit.DONE


def state(one: Alarm) -> str:
    """What an alarm still waits for, or who has seen it."""
    seen = f"seen by {one.acknowledged_by}" if one.acknowledged_at else "not acknowledged"
    ends = ENDS[one.clears] if one.cleared_at is None else ""
    return f"{seen}, {ends}" if ends else seen
