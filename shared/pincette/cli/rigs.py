"""The state of rigs: `rigs`, `timing`, `checks`, `queue`; and events at a simulated one: `rig`."""

from typing import TYPE_CHECKING, Annotated, Any

from msgspec.structs import asdict
from rich.markup import escape
from rich.table import Table
from typer import Argument, Option

from pincette.api.checks import Check
from pincette.api.rigs import Certainty
from pincette.cli import CliError, Exit, opened
from pincette.cli.access import Address, Target
from pincette.cli.readers import integer, number
from pincette.cli.terminal import Json, RigOption, clock, command, group, screen, table
from pincette.core import numerals
from pincette.records.timings import rows

if TYPE_CHECKING:
    from rich.console import Console

    from pincette.api.live import LoopTiming
    from pincette.api.rigs import Rig
    from pincette.client import RigHandle
    from pincette.config import RigFile
    from pincette.config.script import Operation
    from pincette.core.messages import SimCommand

NO_DECIMALS_FROM = 1000.0
QUANTILES = ("p50_s", "p99_s", "p999_s", "max_s")

app = group()
queue_app = group(
    "queue", "show the jobs that wait for the one that runs; resume, move or clear them"
)
app.add_typer(queue_app)


@command(app, "rigs")
def list_rigs(address: Address) -> None:
    """List the rigs, a line each."""
    rigs = address.supervisor().rigs()
    shown = table("rig", "latch", "part", "job", "claimed by", "a job can start", right=())
    for rig in rigs:
        why = "yes" if rig.can_start else "; ".join(rig.reasons)
        stands = rig.standing
        state = _trusted(stands.state, stands.state_certainty, stands.state_age_s)
        part = _trusted(stands.part, stands.part_certainty, stands.part_age_s)
        shown.add_row(rig.name, state, part, rig.active_job or "", *_holder(rig), escape(why))
    address.answer(rigs, shown)


def _holder(rig: "Rig") -> tuple[str]:
    return ("" if rig.claim is None else escape(rig.claim.by),)


def _trusted(shown: str, certainty: Certainty, age_s: float | None) -> str:
    """What is told, with its age where it is believed."""
    if certainty != "believed":
        return shown
    return f"{shown}, believed" if age_s is None else f"{shown}, believed ({age_s:.1f} s old)"


@command(app, "timing")
def show_timing(target: Target) -> int:
    """Show lateness, age and execution time of each program; in lockstep there is nothing."""
    timing = target.rig().timing()
    target.answer(timing, lambda: _show_timing(timing, screen()))
    return Exit.DONE if timing.programs or target.json else Exit.FAILED


def _show_timing(timing: "LoopTiming", console: "Console") -> None:
    if timing.programs:
        console.print(timing_table(timing))
    for name, why in timing.silent.items():
        console.print(f"{name}: {why}", markup=False, soft_wrap=True)


def timing_table(timing: "LoopTiming") -> Table:
    """A line for each program and quantity, in ms."""
    names = ("program", "quantity", "count", "p50 ms", "p99 ms", "p99.9 ms", "max ms", "missed")
    shown = table(*names, right=names[2:])
    for row in rows(timing):
        missed = "" if row["missed"] is None else str(row["missed"])
        spread = [milliseconds(row[name]) for name in QUANTILES]
        shown.add_row(row["program"], row["quantity"], str(row["count"]), *spread, missed)
    return shown


def milliseconds(duration_s: float | None) -> str:
    """A duration in ms; to the µs."""
    return "–" if duration_s is None else f"{1e3 * duration_s:.3f}"


@command(app, "checks")
def show_checks(target: Target) -> int:
    """List the checks; the exit status is 1 if one that is needed fails."""
    checks = target.rig().state().checks
    rows = [
        (one.name, mark(one), figure(one.value), figure(one.limit, one.unit), escape(one.words))
        for one in checks
    ]
    names = ("check", "", "value", "limit", "in words")
    target.answer(checks, table(*names, rows=rows, right=("value", "limit")))
    return Exit.DONE if all(one.ok or not one.needed for one in checks) else Exit.FAILED


def mark(one: Check) -> str:
    """The verdict of a check: ok, fails, or a person should look."""
    if one.ok:
        return "[green]ok[/]"
    return "[red]fails[/]" if one.needed else "[yellow]look[/]"


def figure(value: float | str | None, unit: str = "") -> str:
    """A value with its unit, rounded."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    digits = f"{value:.0f}" if abs(value) >= NO_DECIMALS_FROM else f"{value:.3g}"
    return f"{digits} {unit}".rstrip()


@command(queue_app, "show")
def show_queue(target: Target) -> None:
    """Show the jobs that wait, and why they do not begin."""
    handle = target.rig()
    _queue(target, handle, handle.state())


@command(queue_app, "resume")
def resume_queue(target: Target) -> None:
    """Let a halted queue go on with its next job."""
    handle = target.rig()
    _queue(target, handle, handle.queue("resume"))


@command(queue_app, "move")
def move_queued(
    target: Target,
    job: Annotated[str, Argument(metavar="JOB", help="the id of a job that waits")],
    place: Annotated[
        Any, Argument(metavar="PLACE", parser=integer, help="its place then; 1 is the next")
    ],
) -> None:
    """Give a job that waits another place in the queue."""
    handle = target.rig()
    _queue(target, handle, handle.move(job, place))


@command(queue_app, "clear")
def clear_queue(target: Target) -> None:
    """Stop all jobs that wait."""
    handle = target.rig()
    _queue(target, handle, handle.queue("clear"))


def _queue(target: Target, handle: "RigHandle", rig: "Rig") -> None:
    target.answer(rig.queue, lambda: _show_queue(handle, rig, screen()))


def _show_queue(handle: "RigHandle", rig: "Rig", console: "Console") -> None:
    if rig.queue.halted:
        console.print(f"[yellow]halted[/yellow]: {rig.queue.halted}")
        console.print("`pincette queue resume` goes on, `pincette queue clear` stops all that wait")
    if not rig.queue.length:
        console.print("no job waits")
        return
    waiting = [one.job for one in handle.jobs(100, state="queued")]
    rows = [
        (job.id, job.kind, str(job.position or ""), clock(job.created_at))
        for job in sorted(waiting, key=lambda one: one.position or 0)
    ]
    console.print(table("job", "kind", "place", "asked for", rows=rows, right=("place",)))


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
"""A negative value begins as an option does."""


def send(rig: "RigFile", wanted: "SimCommand", words: list[str]) -> None:
    """Send a command to a rig that is up."""
    from pincette.bus.endpoints import tool_endpoint
    from pincette.bus.protocol import BusError
    from pincette.bus.zenoh_bus import ZenohBus
    from pincette.core.topics import SIM_COMMAND
    from pincette.security.identity import SecurityError

    if rig.simulation is None:
        raise CliError(f"rig {rig.rig.name!r} is real: do at its bench what you want done")
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
    """The command of some words; a target that knows one thing needs no name for it."""
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
        raise CliError(f"{trouble}; `pincette rig` lists what there is")
    return wanted


def _value(text: str) -> float:
    try:
        return numerals.number(text)
    except ValueError as error:
        raise CliError(f"{text!r} is no value: {error}", Exit.USAGE) from error


def operation_rows() -> list[tuple[str, str, str, str]]:
    """Target, what, value and meaning of everything there is."""
    from pincette.config.script import OPERATIONS

    return [
        (target, operation.what, value_text(operation), operation.meaning)
        for target, operations in OPERATIONS.items()
        for operation in operations
    ]


def value_text(operation: "Operation") -> str:
    """What the value of a operation is, and its bounds; empty where it takes none."""
    if not operation.valued:
        return ""
    kept = "" if operation.default is None else f"; {operation.default:g} if not given"
    return f"{operation.quantity} ({operation.least:g} to {operation.most:g}{kept})"


def listing() -> str:
    """The table of everything there is, a line each."""
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
        float, Option("--after-s", parser=number("s"), metavar="s", help="from now on, in s")
    ] = 0.0,
    for_s: Annotated[
        float | None,
        Option("--for-s", parser=number("s"), metavar="s", help="how long a fault lasts, in s"),
    ] = None,
) -> None:
    """Give one command to a rig that is up; without words, list what there is."""
    if not words:
        names = ("target", "what", "value", "meaning")
        form.answer([dict(zip(names, row, strict=True)) for row in operation_rows()], listing())
        return
    wanted = read(words, after_s, for_s)
    send(opened(rig.path), wanted, words)
    when = f"in {after_s:g} s" if after_s else "done"
    form.answer(asdict(wanted), f"{' '.join(words)}: {when}")
