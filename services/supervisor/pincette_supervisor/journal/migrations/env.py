"""Runs the migrations on the given connection; Alembic loads this file by its path."""

from alembic import context

from pincette_supervisor.journal.tables import METADATA

context.configure(connection=context.config.attributes["connection"], target_metadata=METADATA)
context.run_migrations()
