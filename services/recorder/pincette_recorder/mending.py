"""Records that nobody has closed: their writer was killed, or the disk was full."""

import json
import logging
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from pincette.records import folder as files
from pincette.records import mcap_reading
from pincette.records.losses import lost
from pincette.records.mcap_file import NAME
from pincette.records.repair import repair
from pincette.records.tables import write_tables

log = logging.getLogger(__name__)
KILLED = "the recorder ended while this was being recorded"


def unclosed(records: Path) -> Iterator[Path]:
    """Folders of jobs whose record has no end, the oldest first; raises OSError."""
    for path in sorted(records.glob(f"*/{NAME}")):
        if not mcap_reading.is_closed(path):
            yield path.parent


def mend(folder: Path, why: str) -> dict[str, str]:
    """Close a record that broke off, make its tables and its manifest; returns how it ended.

    Where its manifest says already what is wrong with it, that stays.

    Raises
    ------
    OSError
        Where the disk does not let it.
    """
    path = folder / NAME
    try:
        recording = mcap_reading.read(path)
        wrong = write_tables(folder, recording)
        missing = sum(lost(recording.messages).values())
    except ValueError as error:  # of another version; the file itself can be closed all the same
        wrong, missing = [f"no table: {error}"], 0
    why = _manifest(folder).get("detail") or why
    closing = {
        "dropped": str(missing),
        "complete": "false",
        "detail": "; ".join([why, *wrong]),
    }
    closing["messages"] = str(repair(path, closing))
    write_manifest(folder, mcap_reading.read_closing(path)[0], closing)
    log.info("%s: closed with %s messages: %s", folder.name, closing["messages"], why)
    return closing


def write_manifest(folder: Path, about: Mapping[str, str], closing: Mapping[str, str]) -> None:
    """Write the manifest of a record that the supervisor did not finish; raises OSError.

    What the supervisor has said in one of its own is kept.
    """
    told: dict[str, Any] = {key: value for key, value in about.items() if key != "request"}
    told |= _manifest(folder)
    told.pop("files", None)
    complete = closing["complete"] == "true"
    files.write_manifest(folder, {**told, "complete": complete, "detail": closing["detail"]})


def _manifest(folder: Path) -> dict[str, Any]:
    """What a manifest says; nothing where there is none that can be read."""
    with suppress(OSError, ValueError):
        tree: Any = json.loads((folder / files.MANIFEST).read_text(encoding="utf-8"))
        if isinstance(tree, dict):
            return cast("dict[str, Any]", tree)
    return {}
