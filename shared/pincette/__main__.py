"""The command ``pincette``, also ``python -m pincette``.

``run`` loads only what a program of the loop needs, so that the program starts fast, and also runs
where only the packages of the loop are installed. ``estop`` loads only what a stop needs.
"""

import gc
import os
import sys
from collections.abc import Sequence

import pincette
from pincette import __version__
from pincette.cli import Exit

COLLECT_AFTER = 100_000
"""Number of new objects after which a command collects garbage."""
INCOMPLETE = """\
pincette: {missing} is not installed: of pincette's commands only `run NAME` works here,
for the programs of the loop, the rig and the router. The image `pincette` has all of them.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    if given[:1] == ["run"]:
        from pincette.cli import run

        return run.main(given[1:])
    if given[:1] == ["estop"]:
        from pincette.cli import estop

        status = estop.main(given[1:])
        if arguments is None:
            # If a thread were still inside the bus, the interpreter would abort at exit, and the
            # exit status would not report what the actuator has confirmed. All output has been
            # flushed.
            os._exit(status)
        return status
    if arguments is None:
        # Imports create many objects and no garbage: at the default threshold, collections would
        # use a tenth of a command's processor time.
        gc.set_threshold(COLLECT_AFTER)
        pincette.is_command = True
    try:
        from pincette.cli.main import main as every_command
    except ModuleNotFoundError as error:
        if not error.name or error.name.partition(".")[0] == "pincette":
            raise
        if given == ["--version"]:
            print(f"pincette {__version__}")
            return Exit.DONE
        sys.stderr.write(INCOMPLETE.format(missing=error.name.partition(".")[0]))
        return Exit.USAGE
    return every_command(given)


if __name__ == "__main__":
    sys.exit(main())
