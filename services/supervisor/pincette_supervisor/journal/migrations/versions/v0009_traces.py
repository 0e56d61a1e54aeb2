"""Jobs and series keep the trace context of their request."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    """Add the columns."""
    for table in ("jobs", "series"):
        op.add_column(table, sa.Column("traceparent", sa.String))
