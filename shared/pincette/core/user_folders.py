"""Folders of the account that runs a program; an account may have none."""

import os
from pathlib import Path


def config_folder() -> Path | None:
    """Return the folder of the account's settings, or None where the account has no home."""
    return _folder("XDG_CONFIG_HOME", ".config")


def cache_folder() -> Path | None:
    """Return the folder of what can be made again, or None where the account has no home."""
    return _folder("XDG_CACHE_HOME", ".cache")


def is_readable_file(path: Path) -> bool:
    """Return whether a path is a regular file; false where its folder may not be entered."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _folder(variable: str, below_home: str) -> Path | None:
    given = os.environ.get(variable)
    if given:
        return Path(given)
    try:
        return Path.home() / below_home
    except RuntimeError:  # without HOME, and without an entry in the list of accounts
        return None
