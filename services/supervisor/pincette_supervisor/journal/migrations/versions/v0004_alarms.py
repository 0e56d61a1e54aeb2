"""Alarms."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Make the table."""
    op.create_table(
        "alarms",
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=True),
        sa.Column("rig", sa.String, nullable=False),
        sa.Column("job", sa.String),
        sa.Column("severity", sa.String, nullable=False),
        sa.Column("cause", sa.String, nullable=False),
        sa.Column("words", sa.String, nullable=False),
        sa.Column("clears", sa.String, nullable=False),
        sa.Column("count", sa.Integer, nullable=False),
        sa.Column("raised_at", sa.String, nullable=False),
        sa.Column("last_at", sa.String, nullable=False),
        sa.Column("acknowledged_at", sa.String),
        sa.Column("acknowledged_by", sa.String),
        sa.Column("cleared_at", sa.String),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_alarms_rig_cause", "alarms", ["rig", "cause"])
