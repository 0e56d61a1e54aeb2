"""The tables of the first release."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

AUDIT_KEPT = 200_000
AUDIT_IS_APPEND_ONLY = """
CREATE TRIGGER audit_is_append_only BEFORE UPDATE ON audit
BEGIN SELECT RAISE(ABORT, 'the audit log is only added to'); END
"""
AUDIT_KEEPS_THE_NEWEST = f"""
CREATE TRIGGER audit_keeps_the_newest BEFORE DELETE ON audit
WHEN OLD.number > (SELECT MAX(number) FROM audit) - {AUDIT_KEPT}
BEGIN SELECT RAISE(ABORT, 'the audit log keeps its newest {AUDIT_KEPT} entries'); END
"""


def _text(name: str, *, null: bool = False) -> sa.Column[str]:
    return sa.Column(name, sa.String, nullable=null)


def _number() -> sa.Column[int]:
    return sa.Column("number", sa.Integer, primary_key=True, autoincrement=True)


def upgrade() -> None:
    """Create all tables, and the triggers that protect the audit log."""
    _jobs()
    _library()
    _access()
    _events_and_alarms()
    if op.get_bind().dialect.name == "sqlite":
        op.execute(AUDIT_IS_APPEND_ONLY)
        op.execute(AUDIT_KEEPS_THE_NEWEST)


def _jobs() -> None:
    op.create_table(
        "jobs",
        sa.Column("id", sa.String, primary_key=True),
        sa.Column("number", sa.Integer, nullable=False, unique=True),
        _text("kind"),
        sa.Column("rig", sa.String, nullable=False, index=True),
        sa.Column("state", sa.String, nullable=False, index=True),
        _text("cause"),
        sa.Column("ending", sa.JSON(none_as_null=True)),
        sa.Column("request", sa.JSON, nullable=False),
        sa.Column("plan", sa.JSON, nullable=False),
        sa.Column("result", sa.JSON(none_as_null=True)),
        _text("epoch", null=True),
        sa.Column("revision", sa.Integer, nullable=False),
        _text("created_at"),
        _text("started_at", null=True),
        _text("ended_at", null=True),
        _text("requested_by", null=True),
        *(_text(name) for name in ("sample", "batch", "operator", "notes")),
        sa.Column("labels", sa.JSON, nullable=False),
        sa.Column("pinned", sa.Boolean, nullable=False),
        sa.Column("priority", sa.Integer, nullable=False),
        sa.Column("place", sa.Integer),
    )
    op.create_table(
        "actions",
        sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), nullable=False),
        sa.Column("number", sa.Integer, nullable=False),
        _text("type"),
        _text("requested_at"),
        _text("requested_by"),
        _text("applied_at", null=True),
        sa.Column("seq", sa.Integer),
        sa.PrimaryKeyConstraint("job", "number"),
    )
    op.create_table(
        "creations",
        sa.Column("key", sa.String, primary_key=True),
        _text("fingerprint"),
        sa.Column("job", sa.String, sa.ForeignKey("jobs.id"), nullable=False),
        _text("created_at"),
    )


def _library() -> None:
    op.create_table("notes", sa.Column("name", sa.String, primary_key=True), _text("value"))
    op.create_table(
        "recipes",
        _text("name"),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("values", sa.JSON, nullable=False),
        _text("note"),
        _text("created_at"),
        sa.PrimaryKeyConstraint("name", "version"),
    )
    op.create_table(
        "trajectories",
        sa.Column("digest", sa.String, primary_key=True),
        _text("rig"),
        sa.Column("request", sa.JSON, nullable=False),
        _text("created_at"),
    )


def _access() -> None:
    op.create_table(
        "keys",
        sa.Column("name", sa.String, primary_key=True),
        sa.Column("digest", sa.String, nullable=False, unique=True),
        _text("scope"),
        _text("made_at"),
        _text("expires_at", null=True),
        _text("revoked_at", null=True),
        _text("used_at", null=True),
        _text("password", null=True),
    )
    op.create_table(
        "sessions",
        sa.Column("digest", sa.String, primary_key=True),
        sa.Column("key", sa.String, sa.ForeignKey("keys.name"), nullable=False),
        _text("used_at"),
    )
    op.create_table(
        "audit",
        _number(),
        *(_text(name) for name in ("at", "who", "address", "action", "detail")),
        sa.Column("status", sa.Integer, nullable=False),
        sa.Column("count", sa.Integer, nullable=False),
        _text("link"),
        sqlite_autoincrement=True,
    )


def _events_and_alarms() -> None:
    op.create_table(
        "events",
        _number(),
        _text("at"),
        _text("rig"),
        sa.Column("job", sa.String, index=True),
        _text("kind"),
        sa.Column("body", sa.JSON, nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "alarms",
        _number(),
        _text("rig"),
        _text("job", null=True),
        *(_text(name) for name in ("severity", "cause", "words", "clears")),
        sa.Column("count", sa.Integer, nullable=False),
        _text("raised_at"),
        _text("last_at"),
        _text("acknowledged_at", null=True),
        _text("acknowledged_by", null=True),
        _text("cleared_at", null=True),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_alarms_rig_cause", "alarms", ["rig", "cause"])
