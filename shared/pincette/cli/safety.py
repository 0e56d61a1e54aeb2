"""``pincette reset`` and ``alarms``."""

from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from pincette.cli.access import Target
from pincette.cli.options import ALL, Limit
from pincette.cli.readers import integer
from pincette.cli.terminal import clock, command, group, screen, table

if TYPE_CHECKING:
    from pincette.api.events import Alarm, AlarmList
    from pincette.api.rigs import Stopped
    from pincette.client import RigHandle


RAMP_S, LOOK_S = 3.0, 0.05
"""Time limit for the arm to reach the safe voltage before a reset, and the interval of the checks,
in s.
"""

app = group()


@command(app, "reset")
def reset(target: Target) -> None:
    """Acknowledge the cause of the latch, and clear the latch."""
    rig = target.rig()
    answer, cause = cleared(rig)
    target.answer(answer, f"rig {rig.name}: reset; the cause was: {cause}")


def cleared(rig: "RigHandle") -> "tuple[Stopped, str]":
    """Clear the latch of a rig after its arm has come to rest; return the reply and the cause."""
    deadline = monotonic() + RAMP_S
    state = rig.state()
    while state.latch.state == "ramping" and monotonic() < deadline:
        sleep(LOOK_S)
        state = rig.state()
    return rig.reset(), state.latch.words or state.latch.cause or "none"


COLOURS = {"alarm": "red", "warning": "yellow"}
ENDS = {"reset": "until the rig is reset", "condition": "still present", "acknowledge": ""}


def _alarm(text: str) -> int | str:
    return text if text == ALL else integer(text)


@command(app, "alarms")
def alarms(
    target: Target,
    limit: Limit = 50,
    before: Annotated[
        int | None, Option("--before", metavar="ID", help="start below this id")
    ] = None,
    every: Annotated[
        bool, Option("--all", help="show also alarms that have ended and were acknowledged")
    ] = False,
    acknowledge: Annotated[
        list[Any] | None,
        Option(
            "--acknowledge",
            parser=_alarm,
            metavar=f"ID|{ALL}",
            help="acknowledge this alarm, or all open ones; repeatable",
        ),
    ] = None,
) -> None:
    """List the open alarms, newest first, or acknowledge them; nothing moves."""
    if acknowledge:
        _acknowledge(target, acknowledge)
        return
    only = None if every else True
    found = target.supervisor().alarms(limit, rig=target.rig_name, open=only, before=before)
    none = "no alarm yet" if every else "no alarm is open; --all lists earlier ones"
    target.answer(found, (lambda: _show_alarms(found)) if found.alarms else none)


def _acknowledge(target: Target, wanted: list[Any]) -> None:
    supervisor = target.supervisor()
    if ALL in wanted:
        found = supervisor.alarms(500, rig=target.rig_name, open=True).alarms
        wanted = [one.id for one in found if one.acknowledged_at is None]
    seen = [supervisor.acknowledge(number) for number in wanted]
    lines = "\n".join(f"alarm {one.id}: {state(one)}" for one in seen)
    target.answer(seen, lines, "no alarm needs to be acknowledged")


def _show_alarms(found: "AlarmList") -> None:
    from rich.markup import escape

    rows = table("id", "came", "rig", "what", "times", "state", right=("times",))
    for one in found.alarms:
        colour = COLOURS[one.severity] if one.open else "dim"
        words = f"[{colour}]{escape(one.words)}[/]"
        rows.add_row(str(one.id), clock(one.last_at), one.rig, words, str(one.count), state(one))
    console = screen()
    console.print(rows)
    if found.next is not None:
        console.print(f"older ones: --before {found.next}")


def state(one: "Alarm") -> str:
    """Return what must still happen before an open alarm closes: an acknowledgement, or the end of
    its cause.
    """
    seen = f"seen by {one.acknowledged_by}" if one.acknowledged_at else "not acknowledged"
    ends = ENDS[one.clears] if one.cleared_at is None else ""
    return f"{seen}, {ends}" if ends else seen
