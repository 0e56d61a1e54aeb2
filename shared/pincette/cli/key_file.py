"""The key that the command line shows a supervisor: named, of the environment, or of a file."""

import os
import stat
from pathlib import Path

VARIABLE = "PINCETTE_KEY"
AT = "@"
"""Before the name of a file in place of a key."""


class KeyFileError(Exception):
    """A file that cannot be used for a key; the text says which, and what to do."""


def usual() -> Path:
    """Where a key is looked for that nobody names."""
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config) / "pincette" / "key"


def chosen(given: str | None) -> str | None:
    """The key of ``--key``, else of the environment, else of the usual file; None: there is none.

    Raises
    ------
    KeyFileError
        Where a file is named that is not there, others may read, or is empty.
    """
    named = given or os.environ.get(VARIABLE) or None
    if named is None:
        path = usual()
        return _read(path) if path.is_file() else None
    return _read(Path(named.removeprefix(AT))) if named.startswith(AT) else named


def _read(path: Path) -> str:
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no text"
        raise KeyFileError(f"key file {path} cannot be read: {why}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise KeyFileError(
            f"key file {path} has mode {stat.S_IMODE(mode):04o}, so others may read it: "
            f"chmod 600 {path}"
        )
    if not text:
        raise KeyFileError(f"key file {path} is empty")
    return text
