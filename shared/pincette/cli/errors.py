"""How a command fails: light, since every program of a rig starts through it."""

from enum import IntEnum


class Exit(IntEnum):
    """Exit statuses of the command line."""

    DONE = 0
    FAILED = 1
    USAGE = 2
    NO_ANSWER = 3
    NOT_READY = 4
    LIMIT = 5
    INTERRUPTED = 130


class CliError(Exception):
    """Something a person must do something about; the text says what."""

    def __init__(self, text: str, status: int = Exit.FAILED) -> None:
        super().__init__(text)
        self.status = status


DEFAULT_URL = "http://127.0.0.1:8000"
"""Of the supervisor that a command asks."""
