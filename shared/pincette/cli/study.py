"""The word ``paper``."""

import argparse
from pathlib import Path

from pincette.cli.options import Words, does, rigged

ABOUT = "repeat the paper's experiments on a simulated rig; some minutes"


def add(word: Words) -> None:
    """Add ``paper``."""
    one = rigged(word("paper", ABOUT))
    one.add_argument(
        "--out", type=Path, default=Path("data/paper"), metavar="FOLDER", help="%(default)s"
    )
    one.add_argument(
        "--rigs", type=int, default=20, metavar="N", help="drawn at random; %(default)s"
    )
    does(one, paper)


def paper(given: argparse.Namespace) -> int:
    """Run the whole study."""
    # It draws: nothing else waits for the drawing library.
    from pincette.cli.paper import paper as study

    return study(given.rig, given.out, given.rigs)
