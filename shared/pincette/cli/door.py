"""The command ``pincette``. ``run`` loads nothing of what only people's commands need.

So a program of the loop starts sooner, and where only the loop's packages are installed.
"""

import argparse
import sys
from collections.abc import Sequence

from pincette import __version__
from pincette.cli import rig_file, run
from pincette.cli.errors import CliError, Exit
from pincette.cli.options import words

RUN = "run"
PARTIAL = """\
pincette: {missing} is not installed: of pincette's commands this place has `run NAME` alone,
for the programs of the loop, the rig and the router. The image `pincette` has all of them.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    if given[:1] == [RUN]:
        return _run(given)
    try:
        from pincette.cli.main import main as whole
    except ModuleNotFoundError as error:
        if not error.name or error.name.partition(".")[0] == "pincette":
            raise
        if given == ["--version"]:
            print(f"pincette {__version__}")
            return Exit.DONE
        sys.stderr.write(PARTIAL.format(missing=error.name.partition(".")[0]))
        return Exit.USAGE
    return whole(given)


def _run(arguments: Sequence[str]) -> int:
    top = argparse.ArgumentParser(prog="pincette")
    run.add(words(top, "word", "COMMAND"))
    given = top.parse_args(arguments)
    try:
        given.rig = rig_file.chosen(given.rig)
        return given.call(given)
    except CliError as error:
        sys.stderr.write(f"pincette: {error}\n")
        return error.status
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
