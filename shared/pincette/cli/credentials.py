"""Key, certificate authority and operator name that a command sends to a supervisor.

This module imports only the standard library, so that an emergency stop starts without delay.
"""

import os
import stat
from pathlib import Path

from pincette.cli import PKI, CliError, Exit
from pincette.core.files import EncodingError, decoded
from pincette.core.user_folders import config_folder, is_readable_file

DEFAULT_URL = "http://127.0.0.1:8000"
VARIABLE = "PINCETTE_KEY"
FILE_MARK = "@"
"""First character of a value that names a file containing the key."""
LONGEST_NAME = 80
"""Largest length of an operator's name in a request."""
KEY_HELP = (
    f"for a supervisor that requires one, or {FILE_MARK}FILE with it; ${VARIABLE}, else "
    "~/.config/pincette/key, if not given"
)
AUTHORITY = "PINCETTE_AUTHORITY"
AUTHORITY_HELP = (
    f"authority.crt of `security`, for a supervisor over https; ${AUTHORITY}, else that in ${PKI}, "
    "if not given"
)


def authority_of(given: Path | None, pki: str | None) -> Path | None:
    """Return the file of the trusted authority: the given one, else the one in a folder, if any."""
    if given is not None or not pki:
        return given
    return Path(pki) / "authority.crt"


def operator() -> str | None:
    """Return the user name of this terminal, if the environment contains one."""
    name = os.environ.get("USER", "")[:LONGEST_NAME]
    return name if name and name.isascii() and name.isprintable() and name.strip() else None


def find_key(given: str | None) -> str | None:
    """Return the key given by ``--key``, else by the environment, else by the user's file, else
    None.

    Raises CliError if a key file cannot be used. If the account has no home folder, or may not
    enter it, there is no key file.
    """
    key = given or os.environ.get(VARIABLE) or None
    if key is not None and key.startswith(FILE_MARK):
        return _read(Path(key.removeprefix(FILE_MARK)))
    folder = config_folder()
    if key is not None or folder is None:
        return key
    usual = folder / "pincette" / "key"
    return _read(usual) if is_readable_file(usual) else None


def _read(path: Path) -> str:
    try:
        mode = path.stat().st_mode
        text = decoded(path.read_bytes()).strip()
    except (OSError, EncodingError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise CliError(f"key file {path} cannot be read: {why}", Exit.USAGE) from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        why = f"has mode {stat.S_IMODE(mode):04o}, so others may read it: chmod 600 {path}"
        raise CliError(f"key file {path} {why}", Exit.USAGE)
    if not text:
        raise CliError(f"key file {path} is empty: write the key into it", Exit.USAGE)
    return text
