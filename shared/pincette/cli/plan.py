"""``pincette plan``: what a job would do, and the picture of it."""

import argparse
from pathlib import Path

from pincette.cli import job_words
from pincette.cli.job import planned
from pincette.cli.options import Words, addressed, does, words
from pincette.cli.rest import CliError, rig_of

ABOUT = "say what a job would do, with the predicted course and every limit it would break"


def add(word: Words) -> None:
    """Add ``plan`` with every kind."""
    job_words.add(words(word("plan", ABOUT), "what", "KIND"), _plans)


def _plans(word: argparse.ArgumentParser) -> None:
    if word.get_default("kind") in ("grip", "track", "move"):
        word.add_argument(
            "--plot", type=Path, metavar="FILE", help="draw the predicted course there, as PNG"
        )
    does(addressed(word), plan)


def plan(given: argparse.Namespace) -> int:
    """Show a plan; the exit status says whether it is feasible."""
    rig, wishes = rig_of(given), job_words.wishes(given)
    status = planned(rig, given.kind, wishes, machine=given.json)
    picture: Path | None = getattr(given, "plot", None)
    if picture is not None:
        written(picture, rig.plot(given.kind, **wishes))
        if not given.json:
            print(f"plot: {picture}")
    return status


def written(path: Path, content: bytes) -> None:
    """Write a file; raises CliError where it cannot be."""
    try:
        path.write_bytes(content)
    except OSError as error:
        raise CliError(f"{path} cannot be written ({error.strerror}): name another") from error
