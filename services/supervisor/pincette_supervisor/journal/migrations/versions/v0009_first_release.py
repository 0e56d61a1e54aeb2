"""The tables and indexes of the first release."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.exc import DBAPIError

revision = "0009"
"""Lower numbers were used before the first release; journals with them are rejected."""
down_revision = None

JOBS_LISTED_BY = ("rig", "state", "kind", "sample", "batch", "operator", "pinned")
JOBS_SEARCHED = (
    "cause", "requested_by", "sample", "batch", "operator", "notes", "labels", "result",
)  # fmt: skip
"""Columns of ``jobs`` that change and are part of the text of a job."""
# Labels and outcome are written as in JSON, so that a name and its value are one phrase.
WORDS = """new.id || char(10) || new.cause || char(10) || coalesce(new.requested_by, '')
    || char(10) || new.sample || char(10) || new.batch || char(10) || new.operator
    || char(10) || new.notes || char(10) || new.labels || char(10) || '"outcome": '
    || json_quote(json_extract(new.result, '$.outcome'))"""
WORDS_ON_SERVER = """id || ' ' || cause || ' ' || coalesce(requested_by, '') || ' ' || sample
    || ' ' || batch || ' ' || operator || ' ' || notes || ' ' || (labels::text)"""
EXTENSION = """SELECT quote_ident(nspname) FROM pg_extension
    JOIN pg_namespace ON pg_namespace.oid = extnamespace WHERE extname = 'pg_trgm'"""

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

ON_A_SERVER = f"""
CREATE FUNCTION audit_is_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  IF TG_OP = 'DELETE' THEN
    IF OLD.number <= (SELECT MAX(number) FROM audit) - {AUDIT_KEPT} THEN RETURN OLD; END IF;
    RAISE EXCEPTION 'the audit log keeps its newest {AUDIT_KEPT} entries';
  END IF;
  RAISE EXCEPTION 'the audit log is only added to';
END $$;
CREATE TRIGGER audit_is_append_only BEFORE UPDATE OR DELETE ON audit
FOR EACH ROW EXECUTE FUNCTION audit_is_append_only();
CREATE TRIGGER audit_is_not_emptied BEFORE TRUNCATE ON audit
FOR EACH STATEMENT EXECUTE FUNCTION audit_is_append_only();
"""


def _text(name: str, *, null: bool = False) -> sa.Column[str]:
    return sa.Column(name, sa.String, nullable=null)


def _number() -> sa.Column[int]:
    return sa.Column("number", sa.Integer, primary_key=True, autoincrement=True)


def upgrade() -> None:
    """Create all tables, the text search, and the triggers that protect the audit log."""
    _jobs()
    _series()
    _library()
    _access()
    _events_and_alarms()
    if op.get_bind().dialect.name == "sqlite":
        _search_in_file()
        op.execute(AUDIT_IS_APPEND_ONLY)
        op.execute(AUDIT_KEEPS_THE_NEWEST)
    else:
        _search_on_server()
        op.execute(ON_A_SERVER)


def _jobs() -> None:
    op.create_table(
        "jobs",
        sa.Column("id", sa.String, primary_key=True),
        sa.Column("number", sa.Integer, nullable=False, unique=True),
        _text("kind"),
        _text("rig"),
        _text("state"),
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
        _text("traceparent", null=True),
    )
    # A filter by time reads the index alone, whichever other filter comes with it.
    for column in JOBS_LISTED_BY:
        op.create_index(f"ix_jobs_{column}_number", "jobs", [column, "number", "created_at"])
    op.create_index("ix_jobs_number_created_at", "jobs", ["number", "created_at"])
    columns = ["number", "created_at", "rig", "kind", "state", "pinned"]
    op.create_index("ix_jobs_listed", "jobs", columns)
    op.create_index("ix_jobs_counted", "jobs", ["rig", "kind", "state"])
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


def _series() -> None:
    op.create_table(
        "series",
        _number(),
        sa.Column("id", sa.String, nullable=False, unique=True),
        *(_text(name) for name in ("rig", "name", "state", "cause")),
        *(sa.Column(name, sa.JSON, nullable=False) for name in ("request", "jobs")),
        sa.Column("failures", sa.Integer, nullable=False),
        sa.Column("key", sa.String, unique=True),
        _text("fingerprint"),
        _text("requested_by", null=True),
        _text("created_at"),
        _text("ended_at", null=True),
        _text("traceparent", null=True),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_series_rig_state", "series", ["rig", "state"])


def _search_in_file() -> None:
    op.execute("CREATE VIRTUAL TABLE job_search USING fts5(words, tokenize = 'trigram')")
    op.execute(
        "CREATE TRIGGER job_search_insert AFTER INSERT ON jobs BEGIN "
        f"INSERT INTO job_search (rowid, words) VALUES (new.number, {WORDS}); END"
    )
    op.execute(
        f"CREATE TRIGGER job_search_update AFTER UPDATE OF {', '.join(JOBS_SEARCHED)} ON jobs "
        f"BEGIN UPDATE job_search SET words = {WORDS} WHERE rowid = new.number; END"
    )
    op.execute(
        "CREATE TRIGGER job_search_delete AFTER DELETE ON jobs BEGIN "
        "DELETE FROM job_search WHERE rowid = old.number; END"
    )


def _search_on_server() -> None:
    op.execute("CREATE INDEX ix_jobs_search_outcome ON jobs ((result ->> 'outcome'), number)")
    op.execute("CREATE INDEX ix_jobs_search_labels ON jobs USING gin ((labels::jsonb))")
    connection = op.get_bind()
    try:
        with connection.begin_nested():
            connection.execute(sa.text("CREATE EXTENSION IF NOT EXISTS pg_trgm"))
    except DBAPIError:
        return  # not installed, or not permitted: a search by text reads all jobs
    schema = connection.scalar(sa.text(EXTENSION))
    op.execute(
        f"CREATE INDEX ix_jobs_search_words ON jobs USING gin (({WORDS_ON_SERVER}) "
        f"{schema}.gin_trgm_ops)"
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
    op.create_table(
        "learned",
        *(_text(name) for name in ("rig", "program", "job", "learned_at")),
        *(
            sa.Column(name, sa.JSON, nullable=False)
            for name in ("motion", "values_um", "errors_um", "best_um")
        ),
        sa.Column("quiet", sa.Integer, nullable=False),
        sa.PrimaryKeyConstraint("rig", "program"),
    )


def _access() -> None:
    op.create_table(
        "sessions",
        sa.Column("digest", sa.String, primary_key=True),
        _text("key"),
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
