"""One index of all columns that often filter lists of jobs, in the sort order of the lists."""

from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Create the index, for filters by several of its columns."""
    columns = ["number", "created_at", "rig", "kind", "state", "pinned"]
    op.create_index("ix_jobs_listed", "jobs", columns)
