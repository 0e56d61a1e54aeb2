"""Command lines that are parsed but not executed."""

from collections.abc import Sequence
from typing import Any

from typer import Exit
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from pincette.cli.job import JobKinds
from pincette.cli.main import LazyGroup, application, load
from pincette.cli.options import given_fields


def command_of(words: Sequence[str]) -> tuple[TyperCommand, list[str]]:
    """Return the command at the start of a list of words, and the remaining words."""
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
    """Return whether a command line can be parsed; an incomplete one, as in a document, counts
    too."""
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
    """Return the parsed values of a command's words; raises what Typer raises if they are
    invalid."""
    command, rest = command_of(words)
    return command.make_context(" ".join(["pincette", *words[: len(words) - len(rest)]]), rest)


def request_of(*words: str) -> dict[str, Any]:
    """Return the fields of the request that the words of a command produce."""
    return given_fields(parsed(*words).params)
