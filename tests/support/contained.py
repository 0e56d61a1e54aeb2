"""Which programs have a container: those of a rig on one host."""

from pincette.engine.process import programs

BEYOND = "upstream"
"""The program of another host."""


def contained() -> list[str]:
    """Programs that docker-compose.yml runs, by name."""
    return [name for name in programs() if name != BEYOND]
