"""Add indexes for filters of job lists that have had to read all jobs; drop curves of stored
plans.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.exc import DBAPIError

revision = "0003"
down_revision = "0002"

LISTED_BY = ("rig", "state", "kind", "sample", "batch", "operator")
SEARCHED = ("cause", "requested_by", "sample", "batch", "operator", "notes", "labels", "result")
"""Columns of ``jobs`` that change and are part of the text of a job."""
# Labels and outcome are written as in JSON, so that a name and its value are one phrase.
WORDS = """{row}.id || char(10) || {row}.cause || char(10) || coalesce({row}.requested_by, '')
    || char(10) || {row}.sample || char(10) || {row}.batch || char(10) || {row}.operator
    || char(10) || {row}.notes || char(10) || {row}.labels || char(10) || '"outcome": '
    || json_quote(json_extract({row}.result, '$.outcome'))"""
WORDS_ON_SERVER = """id || ' ' || cause || ' ' || coalesce(requested_by, '') || ' ' || sample
    || ' ' || batch || ' ' || operator || ' ' || notes || ' ' || (labels::text)"""
EXTENSION = """SELECT quote_ident(nspname) FROM pg_extension
    JOIN pg_namespace ON pg_namespace.oid = extnamespace WHERE extname = 'pg_trgm'"""


def upgrade() -> None:
    """Create the indexes, and drop the curves of stored plans, which nothing reads."""
    for column in LISTED_BY:
        op.drop_index(f"ix_jobs_{column}_number", "jobs")
    if op.get_bind().dialect.name == "sqlite":
        op.execute("UPDATE jobs SET plan = json_remove(plan, '$.curves')")
        _search_in_file()
    else:
        op.execute("UPDATE jobs SET plan = (plan::jsonb - 'curves')::json")
        _search_on_server()
    # A filter by time reads the index alone, whichever other filter comes with it.
    for column in (*LISTED_BY, "pinned"):
        op.create_index(f"ix_jobs_{column}_number", "jobs", [column, "number", "created_at"])
    op.create_index("ix_jobs_number_created_at", "jobs", ["number", "created_at"])


def _search_in_file() -> None:
    op.execute("CREATE VIRTUAL TABLE job_search USING fts5(words, tokenize = 'trigram')")
    op.execute(
        f"INSERT INTO job_search (rowid, words) SELECT number, {WORDS.format(row='jobs')} FROM jobs"
    )
    new = WORDS.format(row="new")
    op.execute(
        "CREATE TRIGGER job_search_insert AFTER INSERT ON jobs BEGIN "
        f"INSERT INTO job_search (rowid, words) VALUES (new.number, {new}); END"
    )
    op.execute(
        f"CREATE TRIGGER job_search_update AFTER UPDATE OF {', '.join(SEARCHED)} ON jobs BEGIN "
        f"UPDATE job_search SET words = {new} WHERE rowid = new.number; END"
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
