"""``pincette model``: the model in use, what calibrations propose, and deciding about it."""

import argparse

from pydantic import BaseModel

from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does, words
from pincette.cli.output import emit, screen, tree
from pincette.cli.rest import CliError, reached, rig_of
from pincette.cli.show_model import show_model, show_proposal, show_proposals

ABOUT = "show the model in use, and decide about what calibrations propose"
WORDS = {
    "show": "the model in use: every quantity that can be calibrated, and where it comes from",
    "proposals": "what calibrations propose, the newest first",
    "accept": "use what a calibration proposes, as a new version of the model",
    "discard": "do not use what a calibration proposes",
    "use": "go back to a version of the model; 0 is the rig file alone",
}


def add(word: Words) -> None:
    """Add ``model`` with every word below it."""
    below = words(word("model", ABOUT), "what", "WHAT")
    for name, about in WORDS.items():
        one = below(name, about)
        if name in ("accept", "discard"):
            text = "its id, that of its job, or `last`"
            one.add_argument("name", metavar="CALIBRATION", help=text)
        elif name == "use":
            one.add_argument("version", type=int, metavar="VERSION")
        does(addressed(one), model)


def model(given: argparse.Namespace) -> int:
    """Do what one of the words says."""
    console = screen()
    found: BaseModel | list[BaseModel]
    match given.what:
        case "proposals":
            found = [*reached(given).proposals()]
            show = show_proposals
        case "accept" | "discard":
            found = reached(given).decide(_calibration(given), given.what)
            show = show_proposal
        case "use":
            found = rig_of(given).use_model(given.version)
            show = show_model
        case _:
            found = rig_of(given).model()
            show = show_model
    if given.json:
        emit(found)
    else:
        show(tree(found), console)
    return Exit.DONE


def _calibration(given: argparse.Namespace) -> str:
    """The calibration that was named; ``last`` is the newest proposal of the rig."""
    if given.name != "last":
        return str(given.name)
    rig = rig_of(given).name
    found = [one.id for one in reached(given).proposals() if one.rig == rig]
    if not found:
        raise CliError("nothing is proposed yet; `pincette job calibrate` measures")
    return found[0]
