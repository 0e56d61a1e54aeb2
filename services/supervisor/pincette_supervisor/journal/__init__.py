"""Data that outlives a restart."""

import logging

# It logs its plug-ins when it is imported, which does not belong in an operator's log.
logging.getLogger("alembic").setLevel(logging.WARNING)
