"""Typer commands, groups of options that they share, and their output."""

import inspect
import json
import shutil
import sys
from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, fields
from datetime import datetime
from functools import wraps
from pathlib import Path
from textwrap import fill, wrap
from threading import Event, Thread
from time import monotonic
from typing import IO, TYPE_CHECKING, Annotated, Any, TextIO, TypeVar, cast, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from pincette.cli import CliError, Exit, chosen
from pincette.core.streams import LossyWriter

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.cli.screen import Rows

PATIENCE_S = 1.0
"""Time after which a command prints for what it is waiting, in s."""
LAST_OUTPUT_S = 1.0
"""Longest wait, in s, for remaining output at the end of a command that keeps a rig running."""
LABEL_WIDTH = 19
"""Smallest width of the labels of values, in characters."""
BELOW: Mapping[str, Any] = {
    "initial_indent": "  ",
    "subsequent_indent": "  ",
    "break_long_words": False,
    "break_on_hyphens": False,
}
"""Format of a value printed below its label."""
STATE_COLOURS: Mapping[str, str] = {
    "succeeded": "green",
    "running": "cyan",
    "paused": "yellow",
    "awaiting_recovery": "yellow",
    "proposed": "yellow",
    "stopped": "yellow",
    "aborted": "red",
    "failed": "red",
    "interrupted": "red",
}


def screen(*, machine: bool = False) -> "Console":
    """Return the console for text: standard output, or standard error if JSON goes to standard
    output.

    Lines are broken between words, and only in a terminal. A word that is longer than a line, such
    as a path, is not broken, so that it can be copied.
    """
    # Rich is loaded only for printing; a help text does not need it.
    from pincette.cli.screen import Screen

    return Screen(sys.stderr if machine else sys.stdout)


def fitted(text: str, stream: TextIO) -> str:
    """Return a text broken into lines between words if the terminal is too narrow."""
    if not stream.isatty():
        return text
    width = shutil.get_terminal_size().columns
    lines = [
        wrap(
            line,
            width,
            subsequent_indent=line[: len(line) - len(line.lstrip())],
            break_long_words=False,
            break_on_hyphens=False,
        )
        or [""]
        for line in text.splitlines()
    ]
    return "\n".join(part for parts in lines for part in parts) + "\n" * text.endswith("\n")


@contextmanager
def lasting_screen(*, machine: bool = False) -> "Generator[Console]":
    """Return the console of a command that keeps a rig running: its output must neither fail nor
    block.

    Raises
    ------
    CliError
        At the end, if lines could not be written.
    Exit
        At the end, if the reader of the output has paused: an error message could also block.
    """
    from pincette.cli.screen import Screen

    output = LossyWriter(sys.stderr if machine else sys.stdout)
    console = Screen(cast("IO[str]", output))
    try:
        yield console
    except BaseException:
        output.drain(LAST_OUTPUT_S)
        raise
    if not output.drain(LAST_OUTPUT_S):
        raise typer.Exit(Exit.FAILED)
    if output.lost:
        raise CliError(f"{output.lost} lines of output could not be written")


@contextmanager
def patience(what: str) -> Generator[None]:
    """Print on standard error what the command waits for, if it takes longer than ``PATIENCE_S``.

    On a terminal the line counts the seconds and disappears; elsewhere it is printed once.
    """
    done, begun_s, lively = Event(), monotonic(), sys.stderr.isatty()

    def show(text: str) -> None:
        with suppress(OSError, ValueError):
            sys.stderr.write(text)
            sys.stderr.flush()

    def tell() -> None:
        wait_s = PATIENCE_S
        while not done.wait(wait_s):
            spent = f"{what}, {monotonic() - begun_s:.0f} s"
            show(f"\r{spent} " if lively else f"{spent}\n")
            wait_s = PATIENCE_S if lively else None
        if lively and monotonic() - begun_s > PATIENCE_S:
            show("\r\x1b[K")

    teller = Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


def emit(value: Any) -> None:
    """Print a JSON document on one line."""
    sys.stdout.write(json.dumps(tree(value), ensure_ascii=False) + "\n")
    sys.stdout.flush()


def tree(value: Any) -> Any:
    """Return models as dictionaries and lists."""
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json")
    if isinstance(value, list | tuple):
        return [tree(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    return value


def table(
    *names: str, rows: Iterable[Sequence[str]] = (), right: Collection[str] | None = None
) -> "Rows":
    """Return a table without a frame; if ``right`` names no columns, all but the first are
    right-aligned.
    """
    from pincette.cli.screen import Rows

    made = Rows(names, names[1:] if right is None else right)
    for row in rows:
        made.add_row(*row)
    return made


def figures(lines: Sequence[tuple[str, str]], console: "Console") -> None:
    """Print labels and values; if a line is too narrow, the value is printed below its label."""
    width = max([LABEL_WIDTH, *(len(label) for label, _ in lines)])
    for label, text in lines:
        line = f"{label:<{width}} {text}"
        if len(line) > console.width:
            line = f"{label}\n{fill(text, console.width, **BELOW)}"
        console.print(line, markup=False)


def clock(stamp: str | None) -> str:
    """Return a timestamp in local time, with its offset from UTC."""
    if not stamp:
        return ""
    return datetime.fromisoformat(stamp).astimezone().isoformat(sep=" ", timespec="seconds")


Function = Callable[..., int | None]
F = TypeVar("F", bound=Function)


class Options:
    """Base class of groups of options: a dataclass whose fields are annotated as Typer options."""

    __slots__ = ()

    def guarded(self) -> AbstractContextManager[None]:
        """Return the context in which a command with this option group runs."""
        return nullcontext()


@dataclass(frozen=True, slots=True)
class Json(Options):
    """Option for output as JSON."""

    json: Annotated[bool, typer.Option("--json", help="answer in JSON on standard output")] = False

    def answer(self, value: Any, show: "str | Rows | Callable[[], object]", none: str = "") -> None:
        """Print a value as JSON, or call ``show`` to print it as text.

        ``none`` is the text for an empty value.
        """
        if self.json:
            emit(value)
        elif none and not value:
            print(fitted(none, sys.stdout))
        elif isinstance(show, str):
            print(fitted(show, sys.stdout))
        elif callable(show):
            show()
        else:
            screen().print(show)


@dataclass(frozen=True, slots=True)
class RigOption(Options):
    """Option for a rig file."""

    rig: Annotated[Path | None, typer.Option("--rig", metavar="FILE", help="rig file")] = None

    @property
    def path(self) -> Path:
        """Return the path of the named rig file, else that of the environment or the demo."""
        return chosen(self.rig)


class _WithWholeHelp:
    """Command whose complete help text is shown and wrapped in a list of commands."""

    help: str | None

    def get_short_help_str(self, limit: int = 0) -> str:  # noqa: ARG002 - as Typer has it
        return self.help or ""


class Command(_WithWholeHelp, TyperCommand):
    """Typer command with a complete help text."""


class Group(_WithWholeHelp, TyperGroup):
    """Group of commands. The group's name without a command shows the help text."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Show the help text on standard error if there are no arguments."""
        if not args and not ctx.resilient_parsing:
            typer.echo(ctx.get_help(), err=True)
            raise typer.Exit(Exit.USAGE)
        return super().parse_args(ctx, args)


def command(
    app: typer.Typer, name: str, more: Sequence[inspect.Parameter] = (), **settings: Any
) -> Callable[[F], F]:
    """Add a function as a command; a parameter that is an option group is expanded into its
    options.
    """

    def add(function: F) -> F:
        app.command(name, cls=Command, **settings)(expanded(function, more))
        return function

    return add


def group(name: str = "", about: str = "", kind: type[Group] = Group) -> typer.Typer:
    """Return an application to which commands can be added."""
    return typer.Typer(
        name=name or None,
        help=about or None,
        cls=kind,
        rich_markup_mode=None,
        add_completion=False,
    )


def expanded(function: Function, more: Sequence[inspect.Parameter] = ()) -> Function:
    """Return the function with each option-group parameter replaced by the fields of the group.

    ``more`` are additional keyword-only parameters.
    """
    hints = get_type_hints(function, include_extras=True)
    groups: dict[str, type[Any]] = {}
    parameters: list[inspect.Parameter] = []
    of_groups: list[inspect.Parameter] = []
    for parameter in inspect.signature(function).parameters.values():
        annotation = hints[parameter.name]
        if isinstance(annotation, type) and issubclass(annotation, Options):
            groups[parameter.name] = annotation
            own = get_type_hints(annotation, include_extras=True)
            members = fields(groups[parameter.name])
            of_groups += [named(one.name, own[one.name], one.default) for one in members]
        elif parameter.kind is not inspect.Parameter.VAR_KEYWORD:
            parameters.append(named(parameter.name, annotation, parameter.default))

    @wraps(function)
    def call(**given: Any) -> int | None:
        with ExitStack() as stack:
            for name, kind in groups.items():
                own = {one.name: given.pop(one.name) for one in fields(kind)}
                given[name] = kind(**own)
                stack.enter_context(given[name].guarded())
            return function(**given)

    return with_parameters(call, [*parameters, *more, *of_groups])


def named(name: str, annotation: Any, default: Any = None) -> inspect.Parameter:
    """Return a parameter that is passed by name."""
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def with_parameters(function: Function, parameters: Sequence[inspect.Parameter]) -> Function:
    """Return the function with another signature, from which Typer creates its options."""
    function.__dict__["__signature__"] = inspect.Signature(parameters)
    function.__annotations__ = {one.name: one.annotation for one in parameters}
    return function
