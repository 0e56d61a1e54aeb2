"""``run`` and ``estop`` as Typer commands, for help and completion only.

``pincette.__main__`` runs both without Typer.
"""

from collections.abc import Callable, Sequence
from inspect import Parameter
from typing import Annotated, Any

import typer

from pincette.cli import estop, run
from pincette.cli.plain import Option
from pincette.cli.readers import choice
from pincette.cli.terminal import Command, group, named, with_parameters

app = group()


def _add(
    name: str,
    main: Callable[[Sequence[str]], int],
    options: Sequence[Option],
    argument: Parameter | None = None,
) -> None:
    """Add a command that passes its arguments to ``main``."""

    def call(**given: Any) -> int:
        words = [] if argument is None else [str(given[argument.name])]
        for option in options:
            if value := given[option.name]:
                words += [option.flag, str(value)] if option.metavar else [option.flag]
        return main(words)

    parameters = [
        named(one.name, _annotation(one), None if one.metavar else False) for one in options
    ]
    shown = parameters if argument is None else [argument, *parameters]
    app.command(name, cls=Command)(with_parameters(call, shown))


def _annotation(option: Option) -> Any:
    if not option.metavar:
        return Annotated[bool, typer.Option(option.flag, help=option.help, hidden=option.hidden)]
    read = None if option.choices is None else choice(option.choices)
    shown = typer.Option(
        option.flag, metavar=option.metavar, help=option.help, hidden=option.hidden, parser=read
    )
    return Annotated[str | None, shown]


def _program(text: str) -> str:
    try:
        return run.program_name(text)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


_NAME = Annotated[str, typer.Argument(metavar="NAME", parser=_program, help=run.name_help())]
_add("run", run.main, run.OPTIONS, named("name", _NAME, ...))
_add("estop", estop.main, estop.OPTIONS)
