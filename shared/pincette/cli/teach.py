"""The word ``teach``."""

import argparse
from pathlib import Path

from pincette.cli.options import Words, does, rigged

ABOUT = "identify the free response of a rig's arm, nothing in its way"


def add(word: Words) -> None:
    """Add ``teach``."""
    one = rigged(word("teach", ABOUT))
    one.add_argument("--write", type=Path, metavar="OUT", help="write the table there too")
    one.add_argument(
        "--source",
        choices=("identified", "recorded"),
        default="identified",
        help="a model of hysteresis and creep, or the branches as recorded; %(default)s",
    )
    does(one, _given)


def _given(given: argparse.Namespace) -> int:
    # It simulates and fits: nothing else waits for what reckons with arrays.
    from pincette.cli.taught import teach

    return teach(given.rig, given.write, given.source)
