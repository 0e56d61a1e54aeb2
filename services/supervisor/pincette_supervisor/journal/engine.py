"""The data base behind the journal: SQLite in a file. No other module knows which it is."""

import json
import sqlite3
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event
from sqlalchemy.pool import ConnectionPoolEntry

BUSY_S = 10.0
"""How long a statement waits for another program that has the file."""
POOL, OVERFLOW = 8, 64
"""Connections that are kept, and that may come on top: more than there are threads to ask."""
HAND_MADE, MIGRATED = 1, 2
"""``user_version`` of a file made before there were migrations, and of one that has them.

The second is there for programs of before, which would take the file for their own.
"""
WRITES = "journal_writes"


def open_engine(path: Path) -> Engine:
    """Open a file, which is made where there is none, with transactions begun in words."""
    engine = create_engine(
        URL.create("sqlite+pysqlite", database=str(path)),
        connect_args={"timeout": BUSY_S},
        pool_size=POOL,
        max_overflow=OVERFLOW,
        json_serializer=partial(json.dumps, allow_nan=False, ensure_ascii=False),
    )
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return engine


def _prepare(connection: sqlite3.Connection, _entry: ConnectionPoolEntry) -> None:
    # Otherwise the driver begins transactions by itself, and not before CREATE TABLE.
    connection.isolation_level = None
    for pragma in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
        connection.execute(f"PRAGMA {pragma}")


def _begin(connection: Connection) -> None:
    # One that reads first and writes then would be refused where another has written meanwhile.
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def for_writing(engine: Engine) -> Engine:
    """The same data base, its transactions meant for writing from their begin."""
    return engine.execution_options(**{WRITES: True})


def version_of_file(connection: Connection) -> int:
    """Number by which a file of before migrations is known; 0 of an empty one."""
    number: Any = connection.exec_driver_sql("PRAGMA user_version").scalar_one()
    return int(number)


def mark_migrated(connection: Connection) -> None:
    """Let programs of before migrations refuse the file."""
    connection.exec_driver_sql(f"PRAGMA user_version = {MIGRATED}")
