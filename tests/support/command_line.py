"""Command lines that are read, and not carried out."""

from collections.abc import Sequence
from typing import Any

from typer import Exit
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from pincette.cli.job import JobKinds
from pincette.cli.main import LazyGroup, application, load
from pincette.cli.options import given_fields


def command_of(words: Sequence[str]) -> tuple[TyperCommand, list[str]]:
    """The command that words begin with, and the words behind it."""
    found: Any = application()
    rest = list(words)
    while isinstance(found, TyperGroup):
        name = rest.pop(0)
        if isinstance(found, JobKinds) and name not in found.commands:
            found.complete()
        assert name in found.commands, f"no command {name!r}; there are {', '.join(found.commands)}"
        found = load(name) if isinstance(found, LazyGroup) else found.commands[name]
    return found, rest


def is_known(words: Sequence[str]) -> bool:
    """Whether a command line can be read; one that ends too early, as a document has it, too."""
    try:
        parsed(*words)
    except (Exit, IndexError):
        return True
    except TyperException as error:
        return error.message == "" or "Missing" in error.format_message()
    except AssertionError:
        return False
    return True


def parsed(*words: str) -> Any:
    """What a command reads of its words; raises what Typer raises where it cannot."""
    command, rest = command_of(words)
    return command.make_context(" ".join(["pincette", *words[: len(words) - len(rest)]]), rest)


def request_of(*words: str) -> dict[str, Any]:
    """Fields of a request that the words of a command ask for."""
    return given_fields(parsed(*words).params)
