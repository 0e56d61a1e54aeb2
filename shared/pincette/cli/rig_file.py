"""Which rig file the command line means, and what it says where there is none."""

import os
from importlib.resources import as_file, files
from pathlib import Path

from pincette.cli.errors import CliError
from pincette.config import ConfigError, RigFile, read_rig

VARIABLE = "PINCETTE_RIG"
PKI = "PINCETTE_PKI"
"""Names a folder of certificates in place of the rig file's, for tools beside `up --secure`."""
IN_A_CHECKOUT = Path("deploy/rigs/demo.toml")
IN_THE_PACKAGE = "rigs/demo.toml"
"""The same file, as the wheel brings it along."""


def chosen(given: Path | None) -> Path:
    """The file of ``--rig``, else of the environment, else the demo's: a checkout's, or ours.

    Raises
    ------
    CliError
        Where none of them names a file.
    """
    if given is not None:
        return given
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    if IN_A_CHECKOUT.is_file():
        return IN_A_CHECKOUT
    if (ours := brought()) is not None:
        return ours
    raise CliError(
        f"no rig file: {IN_A_CHECKOUT} is not in {Path.cwd()}. Name one with --rig FILE or in "
        f"the environment variable {VARIABLE}, or work in a checkout of pincette"
    )


def brought() -> Path | None:
    """The demo's rig file that was installed with the package; None where it runs in place."""
    with as_file(files("pincette") / IN_THE_PACKAGE) as path:
        return path if path.is_file() else None


def opened(path: Path) -> RigFile:
    """Read a rig file; raises CliError with what is wrong in it."""
    try:
        rig = read_rig(path)
    except ConfigError as error:
        raise CliError(f"{error}\nMend the file, or name another with --rig") from error
    pki = os.environ.get(PKI)
    return rig.secured(Path(pki)) if pki else rig
