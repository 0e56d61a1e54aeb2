"""Data that outlives a restart."""

import logging

# It tells of its plug-ins as it is imported, which is nothing that an operator's log is read for.
logging.getLogger("alembic").setLevel(logging.WARNING)
