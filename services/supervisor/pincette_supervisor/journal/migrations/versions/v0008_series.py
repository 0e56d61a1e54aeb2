"""Series of jobs."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Create the table."""
    op.create_table(
        "series",
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=True),
        sa.Column("id", sa.String, nullable=False, unique=True),
        *(sa.Column(name, sa.String, nullable=False) for name in ("rig", "name", "state", "cause")),
        *(sa.Column(name, sa.JSON, nullable=False) for name in ("request", "jobs")),
        sa.Column("failures", sa.Integer, nullable=False),
        sa.Column("key", sa.String, unique=True),
        sa.Column("fingerprint", sa.String, nullable=False),
        sa.Column("requested_by", sa.String),
        sa.Column("created_at", sa.String, nullable=False),
        sa.Column("ended_at", sa.String),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_series_rig_state", "series", ["rig", "state"])
