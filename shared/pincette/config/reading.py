"""Reader of rig files: TOML, optionally with a base file, and JSON as sent by programs."""

from pathlib import Path
from typing import cast

from pydantic import ValidationError

from pincette.config.rig_file import RigFile
from pincette.config.second import completed
from pincette.config.toml_file import (
    BASE,
    ConfigError,
    Tree,
    laid_over,
    path_beside,
    read_tables,
)
from pincette.core.validation_wording import place, refusal, value_text

ZERO_PERIODS = 10
"""Smallest number of periods over which the force is zeroed."""
ROUNDING = 1e-6
"""Tolerance, in periods, of a product of two decimal numbers."""
SHOWN, MOST_FAULTS = 300, 20
"""Number of characters of a value that an error message shows, and number of faults that it
lists.
"""


def read_rig(path: Path) -> RigFile:
    """Read a rig file; raises ConfigError."""
    tables = read_tables(path)
    base = tables.pop(BASE, None)
    if base is not None:
        if not isinstance(base, str):
            raise ConfigError(
                f"rig file {path}:\n  base = {value_text(base)}: expected the name of a rig file"
            )
        below = read_tables(path_beside(path, base))
        if BASE in below:
            raise ConfigError(f"rig file {path}:\n  base = {base!r}: that file has a base itself")
        try:
            tables = laid_over(_fitting(below, tables), tables)
        except RecursionError as error:
            raise ConfigError(f"rig file {path}: tables are nested too deeply") from error
    try:
        rig = parse_rig(tables)
        _check_zeros(rig)
    except ConfigError as error:
        raise ConfigError(f"rig file {path}:\n{error}") from error
    for name, table in {"sila": rig.sila, "foxglove": rig.foxglove}.items():
        if table.certificate is not None:
            certificate = {"certificate": str(path_beside(path, table.certificate))}
            rig = rig.model_copy(update={name: table.model_copy(update=certificate)})
    return rig if rig.bus.pki is None else rig.secured(path_beside(path, rig.bus.pki))


def _check_zeros(rig: RigFile) -> None:
    """Raise ConfigError if a stated time for zeroing the force is too short.

    Defaults are not checked here: rig files in messages and records state all of them, and must not
    be refused for that.
    """
    period_s = rig.rig.period_s
    least_s = ZERO_PERIODS * period_s
    for name, table in (("grip", rig.grip), ("grip.quick", rig.grip.quick)):
        if "zero_s" in table.model_fields_set and table.zero_s < least_s - ROUNDING * period_s:
            raise ConfigError(
                f"  {name}.zero_s = {table.zero_s:g} s: below {least_s:g} s, {ZERO_PERIODS} "
                f"periods of {1000.0 * period_s:g} ms, which are needed for a zero of the "
                f"force; choose {least_s:g} s or more, or omit it"
            )


CHOICES = {"law": "scheme", "sensor": "driver", "output": "driver"}
"""Key of a table on whose value the other values depend. In a sensor or output table only the
options depend on it."""


def _fitting(below: Tree, above: Tree) -> Tree:
    """Return the tables of the base file, without gains of another law and options of another
    driver.
    """
    result = dict(below)
    for name, choice in CHOICES.items():
        under, over = result.get(name), above.get(name)
        if not isinstance(under, dict) or not isinstance(over, dict):
            continue
        base, own = cast(Tree, under), cast(Tree, over)
        if choice in own and own[choice] != base.get(choice):
            kept = {} if name == "law" else base
            result[name] = {key: value for key, value in kept.items() if key != "options"}
    return result


def parse_rig(tables: Tree) -> RigFile:
    """Validate the tables of a rig file; raises ConfigError with one line for each fault."""
    try:
        return RigFile.model_validate(completed(tables))
    except ValidationError as error:
        raise ConfigError(_faults(error)) from error


def parse_rig_json(text: str) -> RigFile:
    """Read a rig file in JSON, as sent by a program; raises ConfigError."""
    try:
        return RigFile.model_validate_json(text)
    except ValidationError as error:
        raise ConfigError(_faults(error)) from error


def _faults(error: ValidationError) -> str:
    wanted: dict[tuple[str, str], list[str]] = {}
    for fault in error.errors(include_url=False):
        at = place(fault["loc"]), value_text(fault["input"], SHOWN)
        wanted.setdefault(at, []).append(refusal(fault))
    lines = [
        f"  {_legible(where)} = {value}: {_legible(', or '.join(texts))}"
        for (where, value), texts in list(wanted.items())[:MOST_FAULTS]
    ]
    more = len(wanted) - len(lines)
    return "\n".join([*lines, f"  and {more} more"] if more else lines)


def _legible(text: str) -> str:
    """Return a text on one line, whatever characters a file or another program has put into it."""
    short = text if len(text) <= SHOWN else f"{text[:SHOWN]}…"
    return short if short.isprintable() else repr(short)
