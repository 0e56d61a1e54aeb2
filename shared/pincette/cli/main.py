"""All commands of ``pincette``; the module of a command is imported when the command is used."""

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Annotated, Any, cast

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

from pincette import __version__
from pincette.cli import IN_A_CHECKOUT, MEANINGS, RIG_VARIABLE, CliError, Exit
from pincette.cli.terminal import Command, Group, fitted
from pincette.core import plugins
from pincette.core.streams import flushed, prepare_streams

HELP_WIDTH = 100
ABOUT = "Control position and contact force of a piezoelectric microgripper."
STATUSES = "\n".join(f"  {status.value:>3}  {meaning}" for status, meaning in MEANINGS.items())
EPILOG = f"""\
\b
First steps:
  pincette demo                     a simulated rig grips a bead; nothing else is needed
  pincette init bench.toml          write the rig file of a bench; it asks what it needs
  pincette up                       start a rig; then, in another terminal:
  pincette bring-up                 calibrate it, one step after the other
  pincette plan grip --force-mN 15  what a grip would do, and whether it may
  pincette job grip --force-mN 15   grip its part, and follow it
  pincette job track --cycles 3     let position and force follow a path
  pincette job calibrate noise      measure the rig; `pincette model` shows the result
  pincette stop                     stop the running job; a held part stays held
  pincette estop                    stop every rig at once; `pincette reset` clears the latch
  pincette doctor                   what is missing, and how to get it
  pincette rigs                     every rig that the supervisor has found; RIG shows one

\b
Exit status:
{STATUSES}

\b
The rig file is that of --rig, else of the environment variable {RIG_VARIABLE},
else {IN_A_CHECKOUT} in a checkout. `pincette COMMAND --help` says more of each.
"""
COMMANDS: Mapping[str, tuple[str, str]] = {
    "up": ("up", "start every program of a rig on this machine; Ctrl-C stops them"),
    "demo": ("demo", "start a rig, grip its part, show the result and stop"),
    "init": ("init", "prompt for the data of a bench, and write its rig file"),
    "doctor": ("doctor", "report what is missing for a rig, and how to get it"),
    "latency": (
        "latency",
        "measure how punctual this machine is, and report which control period it supports",
    ),
    "plan": (
        "job",
        "predict a job, and list every limit that it would break",
    ),
    "job": ("job", "start a job and follow it, act on one, list them"),
    "series": ("series", "run many jobs by one plan, and control, list and report them"),
    "stop": ("job", "stop the running job, and wait until the rig confirms; a held part stays"),
    "watch": ("watch", "follow a job to its end, or every event of the rigs, until Ctrl-C"),
    "alarms": ("safety", "list the alarms of the rigs, or acknowledge one; nothing moves"),
    "places": ("rigs", "show the places that vision clients publish, and how far they were off"),
    "queue": ("rigs", "resume, move or clear the jobs in the queue"),
    "claim": ("rigs", "claim a rig for a while, give it back, end the claim of another"),
    "backup": ("journal", "write journal, recipes, models and keys of a data folder to one file"),
    "restore": ("journal", "restore a backup to a data folder; the folder must be empty"),
    "records": ("records", "download files of jobs, delete them, or replay a job"),
    "recipe": ("model", "save sets of parameters for parts; `job grip --recipe NAME` uses one"),
    "bring-up": ("bring_up", "run the calibrations of a rig in their order, step by step"),
    "data-sheet": ("data_sheet", "measure the data sheet of a gripper, and save it"),
    "model": ("model", "show the model in use, and accept or discard proposals of calibrations"),
    "learning": ("job", "show what motion programs have learned over their cycles, or erase it"),
    "estop": (
        "plain_commands",
        "stop every rig at once, or one: over REST and directly at the actuators",
    ),
    "reset": ("safety", "clear the latch once the cause has been dealt with"),
    "rigs": ("rigs", "list the rigs of a supervisor: their state, and why no job can start"),
    "rig": (
        "simulated",
        "operate a simulated rig: its part, weights, faults; without arguments: list them",
    ),
    "key": ("keys", "make, list and revoke keys and users of the REST interface"),
    "audit": (
        "journal",
        "list or verify who did what over REST, and who was refused; scope admin",
    ),
    "security": (
        "security",
        "make, list and revoke certificates, which state who may do what on the bus",
    ),
    "run": ("plain_commands", "run one program of a rig in the foreground"),
}
"""Module and description of every command, in the order of the help text."""


class LazyGroup(Group):
    """Top level of the command line: knows every command, and imports only the one that is used."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        own = {name: about for name, (_, about) in COMMANDS.items()}
        abouts = dict.fromkeys(added(), "a command of another package") | own
        for name in (*COMMANDS, *sorted(abouts.keys() - COMMANDS.keys())):
            self.add_command(Command(name, help=abouts[name], rich_markup_mode=None))

    def resolve_command(self, ctx: typer.Context, args: list[str]) -> Any:  # type: ignore[override]
        """Find and import the command with a name."""
        if args[0] not in self.commands and args[0] in plugins.names(plugins.JOB_KINDS):
            raise CliError(
                f"no command {args[0]!r}: `pincette job {args[0]}` starts such a job", Exit.USAGE
            )
        name, _, rest = super().resolve_command(ctx, args)
        return name, None if name is None else load(name), rest


def load(name: str) -> Any:
    """Import a command: the ``app`` of its module."""
    if name in COMMANDS:
        module, about = COMMANDS[name]
        found = typer.main.get_group(import_module(f"pincette.cli.{module}").app).commands[name]
        found.help = about
        return found
    app: typer.Typer = plugins.load(plugins.COMMANDS, name)
    return typer.main.get_group(app).commands[name]


def added() -> list[str]:
    """Return the commands that other packages have registered."""
    return [name for name in plugins.names(plugins.COMMANDS) if name not in COMMANDS]


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"pincette {__version__}")
        raise typer.Exit


def _top(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="show the version and exit"
        ),
    ] = False,
) -> None:
    """Options that precede a command."""


def application() -> TyperGroup:
    """Return the whole command line."""
    app = typer.Typer(
        cls=LazyGroup,
        help=ABOUT,
        epilog=EPILOG,
        rich_markup_mode=None,
        context_settings={"max_content_width": HELP_WIDTH},
    )
    app.callback()(_top)
    found: Any = typer.main.get_command(app)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    # If Rich and Pygments are installed, httpx would import them for its own command line.
    sys.modules.setdefault("httpx._main", cast("Any", None))
    prepare_streams()
    given = sys.argv[1:] if arguments is None else list(arguments)
    return run(application(), given, "pincette")


def run(command: Any, given: Sequence[str], called: str) -> int:
    """Run a Typer command under the name by which it was called; returns the exit status."""
    return flushed(_run(command, given, called), Exit.FAILED)


def _run(command: Any, given: Sequence[str], called: str) -> int:
    try:
        status = command.main(list(given), prog_name=called, standalone_mode=False)
    except CliError as error:
        return _failed("pincette", str(error), error.status)
    except TyperException as error:
        return _misused(error)
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except OSError as error:  # for example a full disk, or a working folder that has been deleted
        return _failed("pincette", str(error), Exit.FAILED)
    return int(status or Exit.DONE)


def _misused(error: TyperException) -> int:
    """Print an error in the use of the command line, and how to get help."""
    context: Any = getattr(error, "ctx", None)
    place = "pincette" if context is None else str(context.command_path)
    close: Sequence[str] = getattr(error, "possibilities", None) or ()
    text = error.message if close else error.format_message()
    hint = f". Did you mean {' or '.join(close)}?" if close else ""
    return _failed(place, f"{text}{hint}\n`{place} --help` lists the possibilities", Exit.USAGE)


def _failed(place: str, text: str, status: int) -> int:
    with suppress(OSError, ValueError):
        sys.stderr.write(fitted(f"{place}: {text}\n", sys.stderr))
    return status
