"""``pincette model``: the model in use, what calibrations propose, and deciding about it."""

import argparse
from collections.abc import Callable
from typing import Any

from rich.console import Console

from pincette.cli.rest import Supervisor
from pincette.cli.show_model import show_model, show_proposal, show_proposals

ABOUT = "show the model in use, and decide about what calibrations propose"
WORDS = {
    "show": "the model in use: every quantity that can be calibrated, and where it comes from",
    "proposals": "what calibrations propose, the newest first",
    "accept": "use what a calibration proposes, as a new version of the model",
    "discard": "do not use what a calibration proposes",
    "use": "go back to a version of the model; 0 is the rig file alone",
}


def add(word: argparse.ArgumentParser, address: Callable[[argparse.ArgumentParser], None]) -> None:
    """Add every word; ``address`` adds where the supervisor is."""
    words = word.add_subparsers(dest="what", required=True, metavar="WHAT")
    for name, text in WORDS.items():
        one = words.add_parser(name, help=text, description=text)
        if name in ("accept", "discard"):
            one.add_argument("name", metavar="CALIBRATION", help="its id, that of its job")
        elif name == "use":
            one.add_argument("version", type=int, metavar="VERSION")
        address(one)


def model(given: argparse.Namespace) -> int:
    """Do what one of the words says."""
    console = Console(highlight=False)
    supervisor = Supervisor(given.url)
    match given.what:
        case "proposals":
            show_proposals(supervisor.get("/calibrations")["calibrations"], console)
        case "accept" | "discard":
            path = f"/calibrations/{given.name}/actions"
            show_proposal(supervisor.post(path, {"type": given.what}), console)
        case "use":
            body = {"type": "use", "version": given.version}
            path = f"/rigs/{_rig(supervisor)}/model/actions"
            show_model(supervisor.post(path, body), console)
        case _:
            show_model(supervisor.get(f"/rigs/{_rig(supervisor)}/model"), console)
    return 0


def _rig(supervisor: Supervisor) -> str:
    rigs: list[dict[str, Any]] = supervisor.get("/rigs")["rigs"]
    return str(rigs[0]["name"])
