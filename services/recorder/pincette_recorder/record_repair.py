"""Closes interrupted records, and repairs records that differ from their manifests."""

import logging
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import mcap.records as mcap

from pincette.core.files import DRAFT, publish
from pincette.records import folder as files
from pincette.records import mcap_reading, record_times
from pincette.records.finished_copy import FinishedCopy
from pincette.records.mcap_file import NAME, Unbuffered
from pincette.records.tables import Written, write_tables_of_file

log = logging.getLogger(__name__)
KILLED = "the recorder ended while this was being recorded"
LOST_LATER = f"{NAME} has lost data after it was closed; the tables have all samples"
TABLES = frozenset((files.SAMPLES, files.BURST, files.TIMING))
"""Files that can be restored from the messages."""
OWN = frozenset((files.LIVE, *TABLES))
"""Files that a recorder writes."""


def unclosed(records: Path) -> Iterator[Path]:
    """Yield folders of jobs whose record was not closed, the oldest first; raises OSError."""
    for path in sorted(records.glob(f"*/{NAME}")):
        if not mcap_reading.is_closed(path):
            yield path.parent


def finish_record(folder: Path, why: str) -> dict[str, str]:
    """Close an interrupted record, with tables and manifest; return how it ended; raises
    OSError.
    """
    path, manifest = folder / NAME, files.read_manifest(folder)
    for name in OWN:  # delete drafts that a killed recorder has left
        for draft in folder.glob(f"{name}*{DRAFT}"):
            draft.unlink()
    if manifest.get("complete") is True and files.SAMPLES in _sound(folder):
        # The tables contain samples that the file has lost.
        written, why = Written([], {}, files.times(folder)), LOST_LATER
    else:
        try:
            written = write_tables_of_file(folder)
        except ValueError as error:  # from another version; the file can still be closed
            written = Written([f"no table: {error}"], {}, {})
    why = manifest.get("detail") or why
    closing = repair(
        path,
        {
            "dropped": str(sum(written.missing.values())),
            "complete": "false",
            "detail": "; ".join([why, *written.wrong]),
            **written.times,
        },
    )
    about = mcap_reading.read_closing(path)[0] | written.times
    write_manifest(folder, about, closing)
    log.info("%s: closed with %s messages: %s", folder.name, closing["messages"], why)
    return closing


def _sound(folder: Path) -> set[str]:
    """Return the names of files that agree with the manifest; raises OSError."""
    lost = files.damaged(folder)
    return {entry["name"] for entry in files.listed(folder)} - {*lost}


def restore(folder: Path) -> list[str]:
    """Compare a closed record with its manifest, and restore its tables and manifest.

    Returns the names of files that stay damaged; none is deleted. Raises OSError.
    """
    found = files.damaged(folder)
    if found == [files.MANIFEST]:
        _restore_manifest(folder)
    elif files.LIVE in found:
        _state_incomplete(folder, f"{files.LIVE} has changed since the record was closed")
    elif tables := TABLES & {*found}:
        try:
            wrong = write_tables_of_file(folder).wrong
        except ValueError as error:  # of another version
            wrong = [str(error)]
        if wrong:
            _state_incomplete(folder, f"{', '.join(sorted(tables))}: {'; '.join(wrong)}")
        else:
            names = sorted(tables)
            log.warning("%s: %s: rebuilt from %s", folder, ", ".join(names), files.LIVE)
            write_manifest(folder, {}, _end(files.read_manifest(folder)), tables)
    return [] if not found else files.damaged(folder)


def _restore_manifest(folder: Path) -> None:
    """Restore the tables and the manifest of a record from its messages; raises OSError."""
    path = folder / NAME
    about, closing = mcap_reading.read_closing(path)
    closing = closing or {"complete": "false", "detail": f"{NAME} does not state its end"}
    try:
        written = write_tables_of_file(folder)
    except ValueError as error:  # of another version
        written = Written([f"no table: {error}"], {}, {})
    kept = sum(isinstance(one, mcap.Message) for one in mcap_reading.entries(path))
    if str(kept) != closing.get("messages", str(kept)):
        written.wrong.append(f"{kept} of {closing['messages']} messages of {NAME} can be read")
    if written.wrong:
        detail = "; ".join(filter(None, (closing["detail"], *written.wrong)))
        closing |= {"complete": "false", "detail": detail}
    write_manifest(folder, about | written.times, closing)
    log.warning("%s: tables and %s rebuilt from %s", folder, files.MANIFEST, files.LIVE)


def _state_incomplete(folder: Path, why: str) -> None:
    """Mark a record as damaged in its manifest; the entries of its files do not change."""
    manifest = files.read_manifest(folder)
    if manifest.get("complete") is not True:  # otherwise the recorder's status names the files
        return
    why = f"{why}; copy it from a backup to {folder}"
    detail = "; ".join(filter(None, (manifest.get("detail"), why)))
    write_manifest(folder, {}, {"complete": "false", "detail": detail}, ())


def _end(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return how a record ended, as its manifest states it."""
    complete = manifest.get("complete") is True
    return {
        "complete": "true" if complete else "false",
        "detail": str(manifest.get("detail", "")),
    }


def write_manifest(
    folder: Path,
    about: Mapping[str, str],
    closing: Mapping[str, str],
    names: Collection[str] = OWN,
) -> None:
    """Write a manifest that lists the files in ``names`` in their present state; raises OSError.

    It keeps the supervisor's entries, including those of other files.
    """
    kept: dict[str, Any] = {name: text for name, text in about.items() if name != "request"}
    kept |= files.read_manifest(folder)
    kept |= {name: about[name] for name in record_times.NAMES if name in about}
    kept.pop("files", None)
    complete = closing["complete"] == "true"
    kept |= {"complete": complete, "detail": closing["detail"]}
    files.write_manifest(folder, kept, names)


def repair(path: Path, closing: Mapping[str, str]) -> dict[str, str]:
    """Close an interrupted record, and return its closing metadata; raises OSError.

    They are those of ``closing``, with the number of messages and the numbers of the first and the
    last sample added.
    """
    # The file is replaced only after its copy is complete and on the disk.
    draft = path.with_name(path.name + DRAFT)
    stream = Unbuffered(draft, "wb")
    copy = FinishedCopy(path, closing)
    try:
        for part in copy:
            stream.write(part)
        stream.sync()
    except BaseException:
        stream.close()
        draft.unlink(missing_ok=True)
        raise
    stream.close()
    publish(draft, path)
    return copy.closing
