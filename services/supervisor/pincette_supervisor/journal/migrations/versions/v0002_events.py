"""Events, keys, recipes and trajectories; jobs gain a number, a revision and an epoch."""

import json
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

OLD = ("jobs", "actions", "notes")
TEXTS_OF_JSON = ("request", "plan", "result")


def upgrade() -> None:
    """Make the tables anew and take over what the old ones hold."""
    for name in OLD:
        op.rename_table(name, f"old_{name}")
    jobs, actions, notes = _taken_over()
    _added()
    connection = op.get_bind()
    _copy_jobs(connection, jobs)
    _copy(connection, "actions", actions)
    _copy(connection, "notes", notes)
    for name in ("actions", "jobs", "notes"):
        op.drop_table(f"old_{name}")


def _taken_over() -> tuple[sa.Table, sa.Table, sa.Table]:
    jobs = op.create_table(
        "jobs",
        sa.Column("id", sa.String, primary_key=True),
        sa.Column("number", sa.Integer, nullable=False, unique=True),
        sa.Column("kind", sa.String, nullable=False),
        sa.Column("rig", sa.String, nullable=False, index=True),
        sa.Column("state", sa.String, nullable=False, index=True),
        sa.Column("cause", sa.String, nullable=False),
        sa.Column("request", sa.JSON, nullable=False),
        sa.Column("plan", sa.JSON, nullable=False),
        sa.Column("result", sa.JSON(none_as_null=True)),
        sa.Column("epoch", sa.String),
        sa.Column("revision", sa.Integer, nullable=False),
        sa.Column("created_at", sa.String, nullable=False),
        sa.Column("started_at", sa.String),
        sa.Column("ended_at", sa.String),
    )
    actions = op.create_table(
        "actions",
        sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), nullable=False),
        sa.Column("number", sa.Integer, nullable=False),
        sa.Column("type", sa.String, nullable=False),
        sa.Column("requested_at", sa.String, nullable=False),
        sa.Column("requested_by", sa.String, nullable=False),
        sa.Column("applied_at", sa.String),
        sa.Column("seq", sa.Integer),
        sa.PrimaryKeyConstraint("job", "number"),
    )
    notes = op.create_table(
        "notes",
        sa.Column("name", sa.String, primary_key=True),
        sa.Column("value", sa.String, nullable=False),
    )
    return jobs, actions, notes


def _added() -> None:
    op.create_table(
        "events",
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=True),
        sa.Column("at", sa.String, nullable=False),
        sa.Column("rig", sa.String, nullable=False),
        sa.Column("job", sa.String, index=True),
        sa.Column("kind", sa.String, nullable=False),
        sa.Column("body", sa.JSON, nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "creations",
        sa.Column("key", sa.String, primary_key=True),
        sa.Column("fingerprint", sa.String, nullable=False),
        sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), nullable=False),
        sa.Column("created_at", sa.String, nullable=False),
    )
    op.create_table(
        "recipes",
        sa.Column("name", sa.String, nullable=False),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("values", sa.JSON, nullable=False),
        sa.Column("note", sa.String, nullable=False),
        sa.Column("created_at", sa.String, nullable=False),
        sa.PrimaryKeyConstraint("name", "version"),
    )
    op.create_table(
        "trajectories",
        sa.Column("digest", sa.String, primary_key=True),
        sa.Column("rig", sa.String, nullable=False),
        sa.Column("request", sa.JSON, nullable=False),
        sa.Column("created_at", sa.String, nullable=False),
    )


def _copy_jobs(connection: sa.Connection, jobs: sa.Table) -> None:
    """One job at a time, the oldest first, since a plan may be large."""
    old = _old("jobs", connection)
    names = connection.execute(sa.select(old.c.id).order_by(old.c.created_at, old.c.id)).scalars()
    for number, name in enumerate(names.all(), start=1):
        row = connection.execute(sa.select(old).where(old.c.id == name)).mappings().one()
        values: dict[str, Any] = {**row, "number": number, "revision": 1}
        for column in TEXTS_OF_JSON:
            if values[column] is not None:
                values[column] = json.loads(values[column])
        connection.execute(jobs.insert().values(values))


def _copy(connection: sa.Connection, name: str, table: sa.Table) -> None:
    old = _old(name, connection)
    names = [column.name for column in old.columns]
    connection.execute(table.insert().from_select(names, sa.select(old)))


def _old(name: str, connection: sa.Connection) -> sa.Table:
    return sa.Table(f"old_{name}", sa.MetaData(), autoload_with=connection)
