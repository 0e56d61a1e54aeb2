"""Indexes with which lists of jobs find their rows without reading all jobs."""

from alembic import op

revision = "0002"
down_revision = "0001"

LISTED_BY = ("rig", "state", "kind", "sample", "batch", "operator")


def upgrade() -> None:
    """Replace the indexes of single columns by indexes in the order of the lists."""
    op.drop_index("ix_jobs_rig", "jobs")
    op.drop_index("ix_jobs_state", "jobs")
    for column in LISTED_BY:
        op.create_index(f"ix_jobs_{column}_number", "jobs", [column, "number"])
    op.create_index("ix_jobs_counted", "jobs", ["rig", "kind", "state"])
