"""The supervisor that the command line speaks with."""

import argparse
import os

from pincette.cli import key_file
from pincette.cli.errors import CliError as CliError
from pincette.cli.errors import Exit
from pincette.cli.key_file import KeyFileError
from pincette.client import RigHandle, Supervisor, WhichRigError
from pincette.client.call import OPERATOR_MAX, who

PATIENCE_S = 0.5
"""How long a person waits to learn that nobody answers."""
FOLLOWED_S = 30.0
"""How long a job is followed on while its supervisor does not answer, as when it is restarted."""


def reached(given: argparse.Namespace) -> Supervisor:
    """The supervisor of ``--url``, with the key of ``--key``."""
    key = key_of(given)
    return Supervisor(given.url, patience_s=PATIENCE_S, operator=operator(), key=key)


def key_of(given: argparse.Namespace | None) -> str | None:
    """The key of ``--key``, else of the environment or a file; raises CliError where it is none."""
    try:
        key = key_file.chosen(getattr(given, "key", None))
        who(None, key)
    except (KeyFileError, ValueError) as error:
        raise CliError(str(error), Exit.USAGE) from error
    return key


def operator() -> str | None:
    """Who sits at this terminal, as far as the environment tells."""
    name = os.environ.get("USER", "")
    return name if name.isascii() and name.isprintable() and 0 < len(name) <= OPERATOR_MAX else None


def rig_of(given: argparse.Namespace) -> RigHandle:
    """The rig of ``--at``, else the only one; raises CliError where there are several."""
    try:
        return reached(given).rig(given.at)
    except WhichRigError as error:
        raise CliError(f"{error} with --at", Exit.USAGE) from error


def silence(url: str | None, error: Exception) -> str:
    """What a person is told where nobody answers."""
    place = f" at {url}" if url else ""
    return (
        f"no supervisor answers{place}: {error}; start one with `pincette up`, "
        "or name another with --url"
    )
