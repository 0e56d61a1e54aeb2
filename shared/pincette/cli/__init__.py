"""Command line: exit statuses, errors for people, and the choice of the rig file."""

import os
from collections.abc import Mapping
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING

from pincette.core.user_folders import is_readable_file


class Exit(IntEnum):
    """Exit statuses of the command line."""

    DONE = 0
    FAILED = 1
    USAGE = 2
    NO_ANSWER = 3
    NOT_READY = 4
    LIMIT = 5
    GOAL_MISSED = 6
    ROUTER_LOCKED = os.EX_TEMPFAIL
    INTERRUPTED = 130


MEANINGS: Mapping[Exit, str] = {
    Exit.DONE: "done; a job that was followed has succeeded",
    Exit.FAILED: "refused or failed; a job that was followed has ended otherwise",
    Exit.USAGE: "the command line cannot be understood",
    Exit.NO_ANSWER: "no answer from a supervisor",
    Exit.NOT_READY: "the rig is latched or not ready; nothing has moved",
    Exit.LIMIT: "a limit of the rig would be broken; nothing has moved",
    Exit.GOAL_MISSED: "a job that was followed has succeeded, but missed its tolerances",
    Exit.ROUTER_LOCKED: "a router that no longer forwarded messages has ended; start it again",
    Exit.INTERRUPTED: "ended by Ctrl-C; a job that was followed continues",
}


class CliError(Exception):
    """Error of a command that cannot be executed; the text states the reason and the remedy."""

    def __init__(self, text: str, status: int = Exit.FAILED) -> None:
        super().__init__(text)
        self.status = status


if TYPE_CHECKING:
    from pincette.config import RigFile

RIG_VARIABLE = "PINCETTE_RIG"
PKI = "PINCETTE_PKI"
"""Environment variable for a folder of certificates that replaces the rig file's; for tools used
with `up --secure`.
"""
IN_A_CHECKOUT = Path("deploy/rigs/demo.toml")
IN_THE_PACKAGE = "rigs/demo.toml"
"""Path of the demo's rig file in the installed package."""


def chosen(given: Path | None) -> Path:
    """Return the path of the rig file given by ``--rig``, else by the environment, else that of the
    demo.

    Raises
    ------
    CliError
        If none of them names a file.
    """
    if given is not None:
        return given
    named = os.environ.get(RIG_VARIABLE)
    if named:
        return Path(named)
    if is_readable_file(IN_A_CHECKOUT):
        return IN_A_CHECKOUT
    if (ours := brought()) is not None:
        return ours
    raise CliError(
        f"no rig file: {IN_A_CHECKOUT} is not in {working_folder()}. Name one with --rig "
        f"FILE or in the environment variable {RIG_VARIABLE}, or run the command in a "
        "checkout of pincette"
    )


def working_folder() -> str:
    """Return the working folder as text, even if it has been deleted."""
    try:
        return str(Path.cwd())
    except OSError:
        return "the working folder, which has been deleted"


def brought() -> Path | None:
    """Return the demo's rig file in the installed package; None in a checkout."""
    from importlib.resources import as_file, files

    with as_file(files("pincette") / IN_THE_PACKAGE) as path:
        return path if path.is_file() else None


def opened(path: Path) -> "RigFile":
    """Read a rig file; raises CliError that lists its errors."""
    # Importing the models of a rig file takes longer than printing a help text.
    from pincette.config import ConfigError, read_rig

    try:
        rig = read_rig(path)
    except ConfigError as error:
        raise CliError(f"{error}\nCorrect the file, or name another with --rig") from error
    pki = os.environ.get(PKI)
    return rig.secured(Path(pki)) if pki else rig
