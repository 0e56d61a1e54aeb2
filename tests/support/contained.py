"""Which programs have a container: those of a rig on one host."""

from pincette.core.service import programs

BEYOND = ("foxglove", "sila", "upstream")
"""Programs of extras, which run where they are asked for, and one of another host."""


def contained() -> list[str]:
    """Programs that docker-compose.yml runs, by name."""
    return [name for name in programs() if name not in BEYOND]
