"""``pincette model``: the model in use, what calibrations propose, and deciding about it."""

import argparse

from pydantic import BaseModel

from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does, words
from pincette.cli.output import emit, screen, tree
from pincette.cli.rest import reached, rig_of
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
    for name, text in WORDS.items():
        one = below(name, text)
        if name in ("accept", "discard"):
            one.add_argument("name", metavar="CALIBRATION", help="its id, that of its job")
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
            found = reached(given).decide(given.name, given.what)
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
