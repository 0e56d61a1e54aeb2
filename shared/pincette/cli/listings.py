"""``pincette rigs``, ``topics`` and ``drivers``: what there is to run, listen to and plug in."""

import argparse
from dataclasses import asdict

from rich.markup import escape

from pincette import plugins
from pincette.cli import drivers, topics
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, does, machine, rigged, url
from pincette.cli.output import emit, screen
from pincette.cli.rest import reached
from pincette.cli.tables import table

RIGS = "list the rigs of a supervisor: what each does, and why no job can start"
TOPICS = "list the keys of a rig and what goes over them"
DRIVERS = "list the drivers of position sensors and voltage outputs, and their options"


def add(word: Words) -> None:
    """Add all three words."""
    does(machine(url(word("rigs", RIGS))), list_rigs)
    does(machine(rigged(word("topics", TOPICS))), list_topics)
    does(machine(word("drivers", DRIVERS)), list_drivers)


def list_rigs(given: argparse.Namespace) -> int:
    """List the rigs, a line each."""
    rigs = reached(given).rigs()
    if given.json:
        emit(rigs)
        return Exit.DONE
    rows = table("rig", "latch", "part", "job", "a job can start", right=())
    for rig in rigs:
        why = "yes" if rig.can_start else "; ".join(rig.reasons)
        rows.add_row(rig.name, rig.latch.state, rig.part, rig.active_job or "", escape(why))
    screen().print(rows)
    return Exit.DONE


def list_topics(given: argparse.Namespace) -> int:
    """List what is published and what is answered."""
    if not given.json:
        return topics.topics(given.rig)
    emit(topics.tree(given.rig))
    return Exit.DONE


def list_drivers(given: argparse.Namespace) -> int:
    """List the drivers that a rig file can name."""
    if not given.json:
        return drivers.drivers()
    emit(
        {kind: [asdict(one) for one in drivers.installed(group)] for group, kind in _groups()},
    )
    return Exit.DONE


def _groups() -> list[tuple[str, str]]:
    return [(group, drivers.TABLES[group]) for group in plugins.DRIVERS]
