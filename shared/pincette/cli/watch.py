"""``pincette watch``: follow a job, or everything that happens to a rig."""

import argparse
import sys
from collections.abc import Iterator
from math import inf
from typing import Any

from rich.text import Text

from pincette.api.event_models import Event
from pincette.cli.exit_status import Exit
from pincette.cli.job import followed
from pincette.cli.job_acts import job_of
from pincette.cli.options import Words, addressed, does, job_named
from pincette.cli.output import screen
from pincette.cli.rest import FOLLOWED_S, reached
from pincette.cli.tables import STATE_COLOURS, clock

ABOUT = "follow a job to its end, or everything that happens to the rigs, until Ctrl-C"
PASSING = ("progress", "dropped")
ALARMING = ("alarm",)
MAIN = {"action": "type", "alarm": "cause", "result": "outcome"}
"""Member that says most, where it is not named as the kind is."""


def add(word: Words) -> None:
    """Add ``watch``."""
    one = job_named(word("watch", ABOUT), optional="everything that happens if not given")
    one.add_argument(
        "--after", type=int, metavar="N", help="begin with the events after this number"
    )
    does(addressed(one), watch)


def watch(given: argparse.Namespace) -> int:
    """Follow a job, a rig, or all."""
    if given.name and not given.json:
        return followed(job_of(given), machine=False)
    if given.name:
        events = job_of(given).patient(FOLLOWED_S).events(given.after or 0)
    else:
        events = _of_rigs(given)
    console = screen()
    for event in events:
        if given.json:
            sys.stdout.write(event.model_dump_json() + "\n")
            sys.stdout.flush()
        elif event.kind not in PASSING:
            console.print(line(event), soft_wrap=True)
    return Exit.DONE


def _of_rigs(given: argparse.Namespace) -> Iterator[Event]:
    """Events of the rig that is named, or of all; asked first whether there is a supervisor."""
    supervisor = reached(given)
    if given.at is None:
        supervisor.rigs()
        return supervisor.patient(inf).events(given.after)
    rig = supervisor.rig(given.at)
    rig.state()
    return rig.patient(inf).events(given.after)


def line(event: Event) -> Text:
    """One event in one line: when, which job, what."""
    body = event.body
    state = str(body.get("state", ""))
    colour = "red" if event.kind in ALARMING else STATE_COLOURS.get(state, "default")
    return Text.assemble(
        (clock(event.at)[11:], "dim"),
        f"  {event.job or event.rig:<20}  {event.kind:<7}  ",
        (words(event.kind, body), colour),
    )


def words(kind: str, body: dict[str, Any]) -> str:
    """What an event says: its main word first, then the rest that is not empty."""
    main = MAIN.get(kind, kind)
    if kind == "alarm" and "alarm" in body:
        return alarm_words(body)
    first = str(body.get(main, ""))
    rest = [
        _said(name, value)
        for name, value in body.items()
        if name not in (main, "event") and value not in (None, "", False, [], {})
    ]
    return ", ".join([first, *rest] if first else rest)


def alarm_words(body: dict[str, Any]) -> str:
    """What has become of an alarm, in the words that the alarm log has for it."""
    about: dict[str, Any] = body["alarm"]
    by = f" by {body['by']}" if body.get("by") and body["did"] == "acknowledged" else ""
    came = f", {about['count']} times" if about.get("count", 1) > 1 else ""
    did = "" if body["did"] == "raised" else f"{body['did']}{by}: "
    return f"{did}{body['words']}{came} (alarm {about.get('id', '?')})"


def _said(name: str, value: object) -> str:
    if value is True:
        return name
    return f"{name} {value:.5g}" if isinstance(value, float) else f"{name} {value}"
