"""``pincette learning``: what programs have learned across their cycles."""

from typing import Annotated

from typer import Argument, Option

from pincette.cli import CliError
from pincette.cli.access import Target
from pincette.cli.terminal import clock, command, group, table

app = group()
learning_app = group("learning", "show what programs have learned across their cycles, or erase it")
app.add_typer(learning_app)


@command(learning_app, "show")
def show(target: Target) -> None:
    """Show every program that has learned, with the error over its cycles."""
    found = target.rig().learning()
    rows = [
        (
            one.program,
            ", ".join(f"{name} {value}" for name, value in one.motion.items()),
            clock(one.learned_at),
            str(one.cycles) + (", over" if one.over else ""),
            " ".join(f"{error:.3f}" for error in one.errors_um),
        )
        for one in found.programs
    ]
    shown = table("program", "motion", "learned", "cycles", "error by cycle / µm", rows=rows)
    target.answer(found, shown if rows else "no program has learned anything yet")


@command(learning_app, "erase")
def erase(
    target: Target,
    program: Annotated[
        str | None, Argument(metavar="[PROGRAM]", help="as `learning show` lists it")
    ] = None,
    everything: Annotated[bool, Option("--all", help="every program of the rig")] = False,
) -> None:
    """Forget what a program has learned: its next job begins anew."""
    if (program is None) != everything:
        raise CliError("name a program, as `pincette learning show` lists it, or give --all")
    found = target.rig().erase_learning(program)
    target.answer(found, f"{found.erased} erased")
