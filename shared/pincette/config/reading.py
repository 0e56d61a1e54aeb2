"""Reads rig files: TOML, also with a base file, and JSON, as programs send it."""

import reprlib
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from pincette.config.programs import Bus, Supervisor
from pincette.config.rig_file import Rig, RigFile
from pincette.config.second import completed
from pincette.config.tables import ConfigError, Table
from pincette.core.files import EncodingError, decoded
from pincette.core.validation_wording import place, refusal

Tree = dict[str, Any]
MOST_BYTES = 4 * 2**20
"""Of a rig file; one with a measured free response is far shorter."""
SHOWN, MOST_FAULTS = 300, 20
"""Characters of a value that a fault repeats, and faults that are listed."""
_SHORT = reprlib.Repr()
_SHORT.maxstring, _SHORT.maxlevel = SHOWN, 3
BASE = "base"
"""Names the file, beside this one, whose values hold where this one has none."""


def read_rig(path: Path) -> RigFile:
    """Read a rig file; raises ConfigError."""
    tables = _tables(path)
    base = tables.pop(BASE, None)
    if base is not None:
        if not isinstance(base, str):
            raise ConfigError(f"rig file {path}:\n  base = {base!r}: wanted the name of a rig file")
        below = _tables(_beside(path, base))
        if BASE in below:
            raise ConfigError(f"rig file {path}:\n  base = {base!r}: that file has a base itself")
        try:
            tables = laid_over(_fitting(below, tables), tables)
        except RecursionError as error:
            raise ConfigError(f"rig file {path}: tables within tables without end") from error
    try:
        rig = parse_rig(tables)
    except ConfigError as error:
        raise ConfigError(f"rig file {path}:\n{error}") from error
    for name, table in {"sila": rig.sila, "foxglove": rig.foxglove}.items():
        if table.certificate is not None:
            certificate = {"certificate": str(_beside(path, table.certificate))}
            rig = rig.model_copy(update={name: table.model_copy(update=certificate)})
    return rig if rig.bus.pki is None else rig.secured(_beside(path, rig.bus.pki))


def _beside(path: Path, name: str) -> Path:
    """Return the path of what a rig file names: beside it, else beside what a link points to."""
    here, there = path.parent / name, path.resolve().parent / name
    return there if there.exists() and not here.exists() else here


NEEDED_FOR_A_STOP: Mapping[str, type[Table]] = {"rig": Rig, "bus": Bus, "supervisor": Supervisor}
"""Tables that lead to a rig's actuator and to its supervisor."""


def read_for_stop(path: Path) -> RigFile:
    """Read only what leads to the actuator and the supervisor; the rest of the file may be wrong.

    The other tables are absent from what is returned. Raises ConfigError where even the rig's name
    cannot be read.
    """
    tables = _tables(path)
    base = tables.pop(BASE, None)
    if isinstance(base, str):
        with suppress(ConfigError):
            tables = laid_over(_tables(_beside(path, base)), tables)
    found = {name: _valid_part(kind, tables.get(name)) for name, kind in NEEDED_FOR_A_STOP.items()}
    if not isinstance(found["rig"], Rig):
        raise ConfigError(f"rig file {path}: [rig] name cannot be read")
    rig = RigFile.model_construct(**cast(Any, found))
    return rig if rig.bus.pki is None else rig.secured(_beside(path, rig.bus.pki))


def _valid_part(kind: type[Table], given: object) -> Table | None:
    """Return a table without its faulty values, or None where one that is missing is needed."""
    values = dict(cast(Tree, given)) if isinstance(given, dict) else {}
    while True:
        try:
            return kind.model_validate(values)
        except ValidationError as error:
            faulty = {str(one["loc"][0]) for one in error.errors() if one["loc"]} & values.keys()
            # A fault of several values together names none of them.
            if not faulty and not values:
                return None
            values = {
                name: value for name, value in values.items() if faulty and name not in faulty
            }


CHOICES = {"law": "scheme", "sensor": "driver", "output": "driver"}
"""What the other values of a table belong to; of a sensor or an output only its options."""


def _fitting(below: Tree, above: Tree) -> Tree:
    """The base file's tables without gains of another law, and options of another driver."""
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


def _tables(path: Path) -> Tree:
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
    except (ValueError, RecursionError) as error:  # also endless digits
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
        return RigFile.model_validate(completed(tables))
    except ValidationError as error:
        raise ConfigError(_faults(error)) from error


def parse_rig_json(text: str) -> RigFile:
    """Read a rig file that a program sends, in JSON; raises ConfigError."""
    try:
        return RigFile.model_validate_json(text)
    except ValidationError as error:
        raise ConfigError(_faults(error)) from error


def _faults(error: ValidationError) -> str:
    wanted: dict[tuple[str, str], list[str]] = {}
    for fault in error.errors(include_url=False):
        at = place(fault["loc"]), _SHORT.repr(fault["input"])
        wanted.setdefault(at, []).append(refusal(fault))
    lines = [
        f"  {_legible(where)} = {value}: {_legible(', or '.join(texts))}"
        for (where, value), texts in list(wanted.items())[:MOST_FAULTS]
    ]
    more = len(wanted) - len(lines)
    return "\n".join([*lines, f"  and {more} more"] if more else lines)


def _legible(text: str) -> str:
    """A text of one line, whatever a file or another program has put into it."""
    short = text if len(text) <= SHOWN else f"{text[:SHOWN]}…"
    return short if short.isprintable() else repr(short)
