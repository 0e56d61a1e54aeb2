"""Learned corrections get a table of their own instead of a note for each rig."""

import json
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"

NOTE = "learned: "
"""Beginning of the names of the notes; the name of the rig follows."""
LISTS = ("values_um", "errors_um", "best_um")


def upgrade() -> None:
    """Create the table, and move the content of the notes into it."""
    learned = op.create_table(
        "learned",
        *(
            sa.Column(name, sa.String, nullable=False)
            for name in ("rig", "program", "job", "learned_at")
        ),
        *(sa.Column(name, sa.JSON, nullable=False) for name in ("motion", *LISTS)),
        sa.Column("quiet", sa.Integer, nullable=False),
        sa.PrimaryKeyConstraint("rig", "program"),
    )
    notes = sa.table("notes", sa.column("name", sa.String), sa.column("value", sa.String))
    connection = op.get_bind()
    of_learned = notes.c.name.startswith(NOTE, autoescape=True)
    for name, value in connection.execute(sa.select(notes).where(of_learned)).all():
        found: list[dict[str, Any]] = json.loads(value)
        missing: dict[str, Any] = {**dict.fromkeys(LISTS, ()), "quiet": 0}
        rows = [{**missing, **row, "rig": name.removeprefix(NOTE)} for row in found]
        if rows:
            connection.execute(learned.insert(), rows)
    connection.execute(notes.delete().where(of_learned))
