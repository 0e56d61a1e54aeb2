"""``pincette rigs``, ``timing``, ``topics`` and ``drivers``: what runs, what is told, what fits."""

import argparse
from dataclasses import asdict

from rich.markup import escape

from pincette import plugins
from pincette.cli import drivers, topics
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does, machine, rigged, url
from pincette.cli.output import emit, screen
from pincette.cli.rest import reached, rig_of
from pincette.cli.show_timing import timing_table
from pincette.cli.tables import table

RIGS = "list the rigs of a supervisor: what each does, and why no job can start"
TIMING = "show how punctual the programs of a loop have been since they were armed"
TOPICS = "list the keys of a rig and what goes over them"
DRIVERS = "list the drivers of position sensors and voltage outputs, and their options"


def add(word: Words) -> None:
    """Add all four words."""
    does(machine(url(word("rigs", RIGS))), list_rigs)
    does(addressed(word("timing", TIMING)), show_timing)
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


def show_timing(given: argparse.Namespace) -> int:
    """Show lateness, age and execution time of each program; in lockstep there is nothing."""
    timing = rig_of(given).timing()
    if given.json:
        emit(timing)
        return Exit.DONE
    console = screen()
    if timing.programs:
        console.print(timing_table(timing))
    for name, why in timing.silent.items():
        console.print(f"{name}: {why}", markup=False, soft_wrap=True)
    return Exit.DONE if timing.programs else Exit.FAILED


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
