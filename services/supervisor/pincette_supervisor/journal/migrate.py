"""Brings a journal of any age to the tables of this program, or leaves it as it was."""

from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection

from pincette_supervisor.journal import engine

MIGRATIONS = Path(__file__).parent / "migrations"
FIRST = "0001"
"""Revision whose tables are those of a file made before there were migrations."""


class ForeignSchemaError(Exception):
    """The journal was written by a program that this one does not know."""


def migrate(connection: Connection) -> None:
    """Bring the tables up to date within the connection's transaction.

    Raises
    ------
    ForeignSchemaError
        Where a newer program has written the journal.
    """
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    config.attributes["connection"] = connection
    known = [step.revision for step in ScriptDirectory.from_config(config).walk_revisions()]
    present = MigrationContext.configure(connection).get_current_heads()
    odd = [revision for revision in present if revision not in known]
    number = engine.version_of_file(connection)
    if odd or number not in (0, engine.HAND_MADE, engine.MIGRATED):
        raise ForeignSchemaError(
            f"has schema {odd[0] if odd else number}, this program knows {known[0]}"
        )
    if present == (known[0],):
        return
    if not present and number == engine.HAND_MADE:
        command.stamp(config, FIRST)
    command.upgrade(config, "head")
    engine.mark_migrated(connection)
