"""Journals of tests: copies of an empty one, since migrations take longer than most tests."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from pincette_supervisor.config import STORE
from pincette_supervisor.journal.store import Store


@cache
def empty_journal() -> bytes:
    """Return the content of a journal that has all tables and no rows."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / STORE
        Store(path).close()
        return path.read_bytes()


def open_store(path: Path) -> Store:
    """Open a journal; a new one is a copy of the empty one."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(empty_journal())
    return Store(path)
