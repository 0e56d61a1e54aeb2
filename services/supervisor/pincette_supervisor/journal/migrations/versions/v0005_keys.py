"""Keys are stored only in the key file; a session refers to the digest of its key."""

# 0004 was used by versions before the first release, whose journals are rejected.
import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0003"


def upgrade() -> None:
    """Note that there were keys, rewrite the sessions, and drop the copy of the keys."""
    op.execute(
        "INSERT INTO notes (name, value) SELECT 'keys_wanted', '1' "
        "WHERE EXISTS (SELECT 1 FROM keys)"
    )
    op.rename_table("sessions", "sessions_by_name")
    op.create_table(
        "sessions",
        sa.Column("digest", sa.String, primary_key=True),
        sa.Column("key", sa.String, nullable=False),
        sa.Column("used_at", sa.String, nullable=False),
    )
    op.execute(
        "INSERT INTO sessions (digest, key, used_at) "
        "SELECT page.digest, keys.digest, page.used_at "
        "FROM sessions_by_name AS page JOIN keys ON keys.name = page.key"
    )
    op.drop_table("sessions_by_name")
    op.drop_table("keys")
