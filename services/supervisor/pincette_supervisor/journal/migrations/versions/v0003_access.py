"""Keys, sessions and the audit log; jobs gain who asked for them."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"

AUDIT_KEPT = 200_000
REFUSES_CHANGES = """
CREATE TRIGGER audit_is_not_changed BEFORE UPDATE ON audit
BEGIN SELECT RAISE(ABORT, 'the audit log is only added to'); END
"""
KEEPS_THE_NEWEST = f"""
CREATE TRIGGER audit_is_kept BEFORE DELETE ON audit
WHEN OLD.number > (SELECT MAX(number) FROM audit) - {AUDIT_KEPT}
BEGIN SELECT RAISE(ABORT, 'the audit log keeps its newest {AUDIT_KEPT} entries'); END
"""


def upgrade() -> None:
    """Make the tables, and the triggers that hold the audit log to being added to."""
    op.add_column("jobs", sa.Column("requested_by", sa.String))
    op.create_table(
        "keys",
        sa.Column("name", sa.String, primary_key=True),
        sa.Column("digest", sa.String, nullable=False, unique=True),
        sa.Column("scope", sa.String, nullable=False),
        sa.Column("made_at", sa.String, nullable=False),
        sa.Column("expires_at", sa.String),
        sa.Column("revoked_at", sa.String),
        sa.Column("used_at", sa.String),
    )
    op.create_table(
        "sessions",
        sa.Column("digest", sa.String, primary_key=True),
        sa.Column("key", sa.String, sa.ForeignKey("keys.name"), nullable=False),
        sa.Column("used_at", sa.String, nullable=False),
    )
    op.create_table(
        "audit",
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=True),
        sa.Column("at", sa.String, nullable=False),
        sa.Column("who", sa.String, nullable=False),
        sa.Column("address", sa.String, nullable=False),
        sa.Column("action", sa.String, nullable=False),
        sa.Column("detail", sa.String, nullable=False),
        sa.Column("status", sa.Integer, nullable=False),
        sa.Column("count", sa.Integer, nullable=False),
        sqlite_autoincrement=True,
    )
    if op.get_bind().dialect.name == "sqlite":
        op.execute(REFUSES_CHANGES)
        op.execute(KEEPS_THE_NEWEST)
