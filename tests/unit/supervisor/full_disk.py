"""A journal on a disk that is full."""

from collections.abc import Generator
from contextlib import contextmanager

import pytest
from sqlalchemy import Connection

from pincette_supervisor.journal.database import Database
from pincette_supervisor.journal.store import StoreError

FULL = "the job store: database or disk is full; check the disk's free space and permissions"


@contextmanager
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Generator[None]:
    """Let every write fail; existing data can be read."""

    @contextmanager
    def refuse(base: Database) -> Generator[Connection]:
        base.trouble = FULL
        raise StoreError(FULL)
        yield

    with monkeypatch.context() as patched:
        patched.setattr(Database, "writing", refuse)
        yield
