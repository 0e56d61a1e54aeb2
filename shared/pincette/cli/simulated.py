"""``pincette rig``: causes events on a simulated rig."""

from typing import TYPE_CHECKING, Annotated

from msgspec.structs import asdict
from typer import Argument, Option

from pincette.cli import CliError, Exit, opened
from pincette.cli.readers import number
from pincette.cli.terminal import Json, RigOption, command, group
from pincette.core import numerals

if TYPE_CHECKING:
    from pincette.config import RigFile
    from pincette.config.script import Operation
    from pincette.core.messages import SimCommand

app = group()

EXAMPLES = """\
Examples:
  pincette rig part remove
  pincette rig weight 5
  pincette rig sensor stuck --for-s 1
  pincette rig arm hysteresis 2
  pincette rig output heal

A rig takes these commands if its file says `scripts = true` in [simulation].
"""

NEGATIVES = {"ignore_unknown_options": True}
"""Command-line settings for commands that accept a negative value, which begins like an option."""


def send(rig: "RigFile", wanted: "SimCommand", words: list[str]) -> None:
    """Send a command to a rig that is up."""
    from pincette.bus.endpoints import tool_endpoint
    from pincette.bus.protocol import BusError
    from pincette.bus.zenoh_bus import ZenohBus
    from pincette.core.topics import SIM_COMMAND
    from pincette.security.identity import SecurityError

    if rig.simulation is None:
        raise CliError(f"rig {rig.rig.name!r} is real: make the change at its bench")
    try:
        bus = ZenohBus(tool_endpoint(rig), rig.rig.name, "orders")
    except SecurityError as error:
        raise CliError(str(error)) from error
    except BusError as error:
        raise CliError(f"{error}\nIs the rig up? `pincette up` starts it") from error
    try:
        bus.call(SIM_COMMAND, wanted)
    except BusError as error:
        raise CliError(f"{' '.join(words)}: {error}") from error
    finally:
        bus.close()


def read(words: list[str], after_s: float, for_s: float | None) -> "SimCommand":
    """Parse the words of a command. If a target has only one operation, its name may be omitted."""
    from pincette.config.script import OPERATIONS, objection
    from pincette.core.messages import SimCommand

    if unknown := [word for word in words if word.startswith("--")]:
        raise CliError(f"no such option: {unknown[0]}; --help lists them", Exit.USAGE)
    target, *rest = words
    operations = OPERATIONS.get(target, ())
    if len(operations) == 1 and rest and rest[0] != operations[0].what:
        rest = [operations[0].what, *rest]
    if len(rest) > 2:
        raise CliError(f"{' '.join(words)}: {len(words)} words; TARGET WHAT VALUE at most")
    what, value = (*rest, "", "")[:2]
    wanted = SimCommand(target, what, _value(value) if value else None, after_s, for_s)
    if trouble := objection(wanted):
        raise CliError(f"{trouble}; `pincette rig` lists all commands")
    return wanted


def _value(text: str) -> float:
    try:
        return numerals.number(text)
    except ValueError as error:
        raise CliError(f"{text!r} is not a value: {error}", Exit.USAGE) from error


def operation_rows() -> list[tuple[str, str, str, str]]:
    """Return target, operation, value and description of all operations."""
    from pincette.config.script import OPERATIONS

    return [
        (target, operation.what, value_text(operation), operation.meaning)
        for target, operations in OPERATIONS.items()
        for operation in operations
    ]


def value_text(operation: "Operation") -> str:
    """Return type and bounds of the value of an operation; empty if it has no value."""
    if not operation.valued:
        return ""
    kept = "" if operation.default is None else f"; {operation.default:g} if not given"
    return f"{operation.quantity} ({operation.least:g} to {operation.most:g}{kept})"


def listing() -> str:
    """Return the table of all operations, one per line."""
    table = operation_rows()
    widths = [max(len(row[column]) for row in table) for column in range(2)]
    lines = [
        f"  {target:<{widths[0]}}  {what:<{widths[1]}}  {meaning}{f'; {value}' if value else ''}"
        for target, what, value, meaning in table
    ]
    return "\n".join(["what can be done to a simulated rig:", *lines, "", EXAMPLES.rstrip()])


@command(
    app, "rig", epilog=f"\b\n{listing()}".replace("\n\n", "\n\n\b\n"), context_settings=NEGATIVES
)
def rig(
    rig: RigOption,
    form: Json,
    words: Annotated[list[str] | None, Argument(metavar="WORD", help="target, what, value")] = None,
    after_s: Annotated[
        float,
        Option(
            "--after-s", parser=number("s"), metavar="s", help="start of the fault in s from now"
        ),
    ] = 0.0,
    for_s: Annotated[
        float | None,
        Option("--for-s", parser=number("s"), metavar="s", help="how long a fault lasts, in s"),
    ] = None,
) -> None:
    """Send one command to a running rig; without words, list all commands."""
    if not words:
        names = ("target", "what", "value", "meaning")
        form.answer([dict(zip(names, row, strict=True)) for row in operation_rows()], listing())
        return
    wanted = read(words, after_s, for_s)
    send(opened(rig.path), wanted, words)
    when = f"in {after_s:g} s" if after_s else "done"
    form.answer(asdict(wanted), f"{' '.join(words)}: {when}")
