"""Programs that have a container."""

from pincette.core.service import programs

BEYOND = ("foxglove", "sila", "upstream")
"""Programs of extras, which have a profile, and a program of another host."""
PROFILES = {"sila": 50052, "foxglove": 8765, "madsci": 2000}
"""Servers that a profile of docker-compose.yml adds, and the port of each on the host."""


def contained() -> list[str]:
    """Return the programs that docker-compose.yml runs, by name."""
    return [name for name in programs() if name not in BEYOND]
