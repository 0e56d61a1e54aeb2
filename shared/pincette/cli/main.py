"""The words of the command line, and what each calls."""

import argparse
import sys
from collections.abc import Callable, Sequence

from pincette import __version__
from pincette.cli import (
    alarms,
    audit,
    bench,
    checks,
    diagnosis,
    exit_status,
    job,
    job_acts,
    key,
    latency,
    listings,
    model,
    plan,
    queue,
    recipes,
    record_words,
    replay,
    rig_file,
    rig_orders,
    run,
    security,
    stop,
    study,
    teach,
    up,
    watch,
)
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, words
from pincette.cli.output import emit
from pincette.cli.rest import CliError, silence
from pincette.client import ClientError, NoAnswerError, ProblemError

ABOUT = "Control position and contact force of a piezoelectric microgripper."
EXAMPLES = f"""\
to begin with:
  pincette demo                     a simulated rig grips a bead; nothing else is needed
  pincette up                       start a rig; then, in another terminal:
  pincette plan grip --force-mN 15  what a grip would do, and whether it may
  pincette job grip --force-mN 15   grip its part, and follow it
  pincette job track --cycles 3     let position and force follow a path
  pincette calibrate noise          find out what the rig is; `pincette model` shows the result
  pincette stop                     stop the job that runs; a held part stays held
  pincette estop                    stop every rig at once; `pincette reset` clears the latch
  pincette doctor                   what is missing, and how to get it
  pincette rigs                     every rig that the supervisor has found

exit status:
{exit_status.table()}

The rig file is that of --rig, else of the environment variable {rig_file.VARIABLE},
else {rig_file.IN_A_CHECKOUT} in a checkout. `pincette COMMAND --help` says more of each.
"""
COMMANDS: Sequence[Callable[[Words], None]] = (
    up.add,
    diagnosis.add,
    latency.add,
    plan.add,
    job.add,
    job_acts.add_stop,
    watch.add,
    alarms.add,
    checks.add,
    queue.add,
    record_words.add,
    replay.add,
    recipes.add,
    model.add,
    stop.add,
    listings.add,
    rig_orders.add,
    teach.add,
    study.add,
    key.add,
    audit.add,
    security.add,
    bench.add,
    run.add,
)
"""What adds each word, in the order of the help."""


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    top = argparse.ArgumentParser(
        prog="pincette",
        description=ABOUT,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=f"pincette {__version__}")
    word = words(top, "word", "COMMAND")
    for add in COMMANDS:
        add(word)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    reconfigure = getattr(sys.stdout, "reconfigure", None)
    if reconfigure is not None:
        # A terminal that cannot show µ is no reason to fail.
        reconfigure(errors="replace")
    given = parser().parse_args(arguments)
    try:
        if "rig" in given:
            given.rig = rig_file.chosen(given.rig)
        return given.call(given)
    except CliError as error:
        return _failed(str(error), error.status)
    except NoAnswerError as error:
        return _failed(silence(getattr(given, "url", None), error), Exit.NO_ANSWER)
    except ClientError as error:
        if isinstance(error, ProblemError) and getattr(given, "json", False):
            emit(error.problem)
        return _failed(str(error), exit_status.of_error(error))
    except KeyboardInterrupt:
        return Exit.INTERRUPTED


def _failed(text: str, status: int) -> int:
    sys.stderr.write(f"pincette: {text}\n")
    return status
