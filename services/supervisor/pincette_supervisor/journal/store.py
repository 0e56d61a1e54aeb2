"""Jobs and their actions in SQLite, so that what was accepted survives a restart.

Never called from the event loop: a slow disk must not hold up a stop.
"""

import json
import sqlite3
import threading
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from pincette.api.states import STATES, ActionType, JobState

SCHEMA_VERSION = 1
SCHEMA = """
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, kind TEXT NOT NULL, rig TEXT NOT NULL, state TEXT NOT NULL,
    cause TEXT NOT NULL, request TEXT NOT NULL, plan TEXT NOT NULL, result TEXT,
    created_at TEXT NOT NULL, started_at TEXT, ended_at TEXT
) STRICT;
CREATE TABLE actions (
    job TEXT NOT NULL REFERENCES jobs (id), number INTEGER NOT NULL, type TEXT NOT NULL,
    requested_at TEXT NOT NULL, requested_by TEXT NOT NULL, seq INTEGER,
    PRIMARY KEY (job, number)
) STRICT;
CREATE TABLE notes (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
"""
CHANGING = ("state", "cause", "result", "started_at", "ended_at")


class StoreError(OSError):
    """The store cannot be used; the text says which file, and what to do."""


@dataclass(frozen=True, slots=True)
class ActionRow:
    """An action and the sample at which it took effect."""

    type: ActionType
    requested_at: str
    by: str
    seq: int | None = None


@dataclass(frozen=True, slots=True)
class JobRow:
    """A job as it is kept."""

    id: str
    kind: str
    rig: str
    state: JobState
    request: dict[str, Any]
    plan: dict[str, Any]
    created_at: str
    cause: str = ""
    result: dict[str, Any] | None = None
    started_at: str | None = None
    ended_at: str | None = None
    actions: tuple[ActionRow, ...] = field(default=())


def utc_now() -> str:
    """The present time in UTC, for people; nothing in the loop reads it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _unusable(path: Path, error: sqlite3.Error) -> StoreError:
    return StoreError(
        f"the job store {path} cannot be used: {error}; move it away to begin a new one"
    )


class Store:
    """One file; safe to use from several threads."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._lock = threading.Lock()
        try:
            self._base = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
        except sqlite3.Error as error:
            raise _unusable(path, error) from error
        try:
            self._base.execute("PRAGMA journal_mode = WAL")
            self._prepare(path)
        except sqlite3.Error as error:
            self._base.close()
            raise _unusable(path, error) from error
        except StoreError:
            self._base.close()
            raise

    def _prepare(self, path: Path) -> None:
        (version,) = self._base.execute("PRAGMA user_version").fetchone()
        if version == 0:
            self._base.executescript(f"BEGIN; {SCHEMA} PRAGMA user_version = {SCHEMA_VERSION}; END")
        elif version != SCHEMA_VERSION:
            raise StoreError(
                f"the job store {path} has schema {version}, this program knows {SCHEMA_VERSION}: "
                "use the version that wrote it, or move the file away"
            )

    def interrupt_left_over(self, at: str) -> list[str]:
        """Mark jobs that an earlier run of the supervisor left unfinished; returns their names."""
        with self._lock:
            rows = self._base.execute("SELECT id, state FROM jobs").fetchall()
            left = [name for name, state in rows if not STATES[cast(JobState, state)].terminal]
            for name in left:
                self._base.execute(
                    "UPDATE jobs SET state = 'interrupted', ended_at = ?, cause = ? WHERE id = ?",
                    (at, "the supervisor ended while the job ran", name),
                )
        return left

    def add(self, job: JobRow) -> None:
        """Keep a new job."""
        values = (job.id, job.kind, job.rig, job.state, job.cause)
        texts = (json.dumps(job.request), json.dumps(job.plan), job.created_at)
        with self._lock:
            self._base.execute(
                "INSERT INTO jobs (id, kind, rig, state, cause, request, plan, created_at) "
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (*values, *texts),
            )

    def change(self, name: str, **values: object) -> None:
        """Change some of state, cause, result, started_at and ended_at."""
        odd = values.keys() - set(CHANGING)
        if odd:
            raise ValueError(f"a job's {', '.join(sorted(odd))} cannot be changed")
        if values.get("result") is not None:
            values["result"] = json.dumps(values["result"], allow_nan=False)
        assignments = ", ".join(f"{column} = ?" for column in values)
        with self._lock:
            self._base.execute(
                f"UPDATE jobs SET {assignments} WHERE id = ?", (*values.values(), name)
            )

    def add_action(self, name: str, action: ActionRow) -> int:
        """Keep an action that was asked for; returns its number within the job."""
        with self._lock:
            (number,) = self._base.execute(
                "SELECT count(*) FROM actions WHERE job = ?", (name,)
            ).fetchone()
            self._base.execute(
                "INSERT INTO actions VALUES (?, ?, ?, ?, ?, ?)",
                (name, number, action.type, action.requested_at, action.by, action.seq),
            )
        return int(number)

    def action_took_effect(self, name: str, number: int, seq: int) -> None:
        """Note the sample at which an action took effect."""
        with self._lock:
            self._base.execute(
                "UPDATE actions SET seq = ? WHERE job = ? AND number = ?", (seq, name, number)
            )

    def get(self, name: str) -> JobRow | None:
        """One job; None where there is none of this name."""
        found = self._select("WHERE id = ?", (name,))
        return found[0] if found else None

    def newest(
        self, limit: int, *, kind: str | None = None, state: JobState | None = None
    ) -> list[JobRow]:
        """Jobs, the newest first; only those of a kind and in a state, where they are named."""
        return self._select(
            "WHERE (?1 IS NULL OR kind = ?1) AND (?2 IS NULL OR state = ?2) "
            "ORDER BY created_at DESC, id DESC LIMIT ?3",
            (kind, state, limit),
        )

    def _select(self, clause: str, values: tuple[object, ...]) -> list[JobRow]:
        with self._lock, closing(self._base.cursor()) as cursor:
            cursor.execute(
                "SELECT id, kind, rig, state, request, plan, created_at, cause, result, "
                f"started_at, ended_at FROM jobs {clause}",
                values,
            )
            rows = cursor.fetchall()
            actions = {
                row[0]: tuple(
                    ActionRow(*fields)
                    for fields in cursor.execute(
                        "SELECT type, requested_at, requested_by, seq FROM actions "
                        "WHERE job = ? ORDER BY number",
                        (row[0],),
                    )
                )
                for row in rows
            }
        return [_row(row, actions[row[0]]) for row in rows]

    def note(self, name: str, value: str) -> None:
        """Keep a fact of the rig beyond a restart."""
        with self._lock:
            self._base.execute("INSERT OR REPLACE INTO notes VALUES (?, ?)", (name, value))

    def noted(self, name: str) -> str | None:
        """A fact kept under this name."""
        with self._lock:
            row = self._base.execute("SELECT value FROM notes WHERE name = ?", (name,)).fetchone()
        return None if row is None else str(row[0])

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._base.close()


def _row(values: tuple[Any, ...], actions: tuple[ActionRow, ...]) -> JobRow:
    name, kind, rig, state, request, plan, created_at, cause, result, started_at, ended_at = values
    return JobRow(
        id=name,
        kind=kind,
        rig=rig,
        state=state,
        request=json.loads(request),
        plan=json.loads(plan),
        created_at=created_at,
        cause=cause,
        result=None if result is None else json.loads(result),
        started_at=started_at,
        ended_at=ended_at,
        actions=actions,
    )
