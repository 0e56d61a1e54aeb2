"""Folder of settings of the account that runs a program; an account may have none."""

import os
from pathlib import Path


def config_folder() -> Path | None:
    """Return the folder of the account's settings, or None if the account has no home."""
    if given := os.environ.get("XDG_CONFIG_HOME"):
        return Path(given)
    try:
        return Path.home() / ".config"
    except RuntimeError:  # without HOME, and without an entry in the list of accounts
        return None


def is_readable_file(path: Path) -> bool:
    """Return whether a path is a regular file; False if its folder may not be entered."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
