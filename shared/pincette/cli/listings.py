"""``pincette topics`` and ``pincette drivers``: what there is to listen to and to plug in."""

import argparse
from dataclasses import asdict

from pincette import plugins
from pincette.cli import drivers, topics
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, does, machine, rigged
from pincette.cli.output import emit

TOPICS = "list the keys of a rig and what goes over them"
DRIVERS = "list the drivers of position sensors and voltage outputs, and their options"


def add(word: Words) -> None:
    """Add both words."""
    does(machine(rigged(word("topics", TOPICS))), list_topics)
    does(machine(word("drivers", DRIVERS)), list_drivers)


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
