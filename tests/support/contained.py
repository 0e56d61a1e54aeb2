"""Which programs have a container: those of a rig on one host."""

from pincette.engine.process import programs

BEYOND = ("sila", "upstream")
"""A program of an extra that the images have not, and one of another host."""


def contained() -> list[str]:
    """Programs that docker-compose.yml runs, by name."""
    return [name for name in programs() if name not in BEYOND]
