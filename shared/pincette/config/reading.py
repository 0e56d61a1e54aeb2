"""Reads rig files: TOML, where it may be laid over another file, and JSON, as programs tell it."""

import tomllib
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from pincette.config.rig_file import RigFile
from pincette.config.tables import ConfigError

Tree = dict[str, Any]
BASE = "base"
"""Names the file, beside this one, whose values hold where this one has none."""


def read_rig(path: Path) -> RigFile:
    """Read a rig file.

    Raises
    ------
    ConfigError
        Where the file is missing, is not TOML, or has an unknown key or an impossible value.
    """
    tables = _tables(path)
    base = tables.pop(BASE, None)
    if base is not None:
        if not isinstance(base, str):
            raise ConfigError(f"rig file {path}:\n  base = {base!r}: wanted the name of a rig file")
        below = _tables(path.parent / base)
        if BASE in below:
            raise ConfigError(f"rig file {path}:\n  base = {base!r}: that file has a base itself")
        tables = laid_over(below, tables)
    try:
        return parse_rig(tables)
    except ConfigError as error:
        raise ConfigError(f"rig file {path}:\n{error}") from error


def _tables(path: Path) -> Tree:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"rig file {path}: {error.strerror}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"rig file {path} is not TOML: {error}") from error


def laid_over(below: Tree, above: Tree) -> Tree:
    """A tree with the values of another in place of its own, table by table."""
    result = dict(below)
    for key, value in above.items():
        under = result.get(key)
        both = isinstance(value, dict) and isinstance(under, dict)
        result[key] = laid_over(cast(Tree, under), cast(Tree, value)) if both else value
    return result


def parse_rig(tables: Tree) -> RigFile:
    """Check the tables of a rig file; raises ConfigError with one line for each fault."""
    try:
        return RigFile.model_validate(tables)
    except ValidationError as error:
        raise ConfigError(_faults(error)) from error


def parse_told(text: str) -> RigFile:
    """Read a rig file as a program tells it, in JSON; raises ConfigError."""
    try:
        return RigFile.model_validate_json(text)
    except ValidationError as error:
        raise ConfigError(_faults(error)) from error


def _faults(error: ValidationError) -> str:
    return "\n".join(
        f"  {'.'.join(str(part) for part in fault['loc'])} = {fault['input']!r}: {fault['msg']}"
        for fault in error.errors(include_url=False)
    )
