"""Data that the supervisor keeps across restarts."""

import logging

# Alembic logs its plug-ins when it is imported, which does not belong in an operator's log.
logging.getLogger("alembic").setLevel(logging.WARNING)
