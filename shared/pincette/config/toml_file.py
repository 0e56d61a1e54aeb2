"""Read the tables of a TOML file, and merge them with those of its base file; nothing is validated.

This module imports no validation library, so that an emergency stop does not wait for the import.
"""

import tomllib
from pathlib import Path
from typing import Any, cast

from pincette.core.files import EncodingError, decoded

Tree = dict[str, Any]
MOST_BYTES = 4 * 2**20
"""Largest allowed size of a rig file, in bytes; a file with a measured free response is far
smaller.
"""
BASE = "base"
"""Key for the path of the base file, whose values apply where a rig file states none."""


class ConfigError(ValueError):
    """Error for a rig file that cannot be used; the text names file, key, value and remedy."""


def read_tables(path: Path) -> Tree:
    """Return the tables of a TOML file; raises ConfigError."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        link = f", a link to {path.resolve(strict=False)}" if path.is_symlink() else ""
        raise ConfigError(f"rig file {path}{link}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"rig file {str(path)!r}: no file can have this name") from error
    if len(content) > MOST_BYTES:
        raise ConfigError(f"rig file {path}: larger than {MOST_BYTES} bytes")
    try:
        return tomllib.loads(decoded(content))
    except EncodingError as error:
        raise ConfigError(f"rig file {path}: {error}") from error
    except (ValueError, RecursionError) as error:  # also rejects an endless number
        raise ConfigError(f"rig file {path} is not TOML: {error}") from error


def path_beside(path: Path, name: str) -> Path:
    """Return the path of a file that a rig file names.

    The file is in the folder of the rig file or, if the rig file is a link, in the folder of the
    link's target.
    """
    here, there = path.parent / name, path.resolve().parent / name
    return there if there.exists() and not here.exists() else here


def laid_over(below: Tree, above: Tree) -> Tree:
    """Return the tables ``below`` with their values replaced by those of ``above``."""
    result = dict(below)
    for key, value in above.items():
        under = result.get(key)
        both = isinstance(value, dict) and isinstance(under, dict)
        result[key] = laid_over(cast(Tree, under), cast(Tree, value)) if both else value
    return result
