"""``pincette estop``, ``reset`` and ``alarms``; an estop goes to the actuator if REST fails."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from socket import create_connection
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from pincette.cli import CliError, opened
from pincette.cli.access import Authority, Key, Target, authority_of, key_of, operator
from pincette.cli.options import Limit
from pincette.cli.terminal import Json, RigOption, clock, command, group, screen, table

if TYPE_CHECKING:
    from pincette.api.events import Alarm, AlarmList
    from pincette.api.rigs import Stopped
    from pincette.bus.topology import SessionConfig
    from pincette.bus.zenoh_bus import ZenohBus
    from pincette.client import RigHandle
    from pincette.config import RigFile


REST_S = 2.0
"""How long the supervisor may take to answer."""
RAMP_S, LOOK_S = 3.0, 0.05
"""How long a reset waits for an arm that is on its way to the safe voltage."""
ASK_S = 1.0
"""How long an actuator may take to answer."""
CONNECT_S = 1.0
ACTUATOR = "actuator"
SUPERVISOR = "through the supervisor"
STRAIGHT, ROUTED = "at the actuator", "through the router"

app = group()


@command(app, "estop")
def estop(
    rig: RigOption,
    form: Json,
    url: Annotated[
        str | None, Option("--url", help="of the supervisor; as the rig file says if not given")
    ] = None,
    key: Key = None,
    authority: Authority = None,
    rig_name: Annotated[
        str | None,
        Option("--rig-name", metavar="RIG", help="the only rig to stop; every one if not given"),
    ] = None,
) -> None:
    """Trip the actuators through the supervisor, else directly, else through the router."""
    from pincette.client import ClientError, Supervisor

    file = opened(rig.path)
    begin = monotonic()
    address = url or file.supervisor.url
    trouble: list[str] = []
    try:
        with Supervisor(
            address,
            timeout_s=REST_S,
            patience_s=0.0,
            operator=operator(),
            key=key_of(key),
            authority=authority_of(authority, file.bus.pki),
        ) as supervisor:
            stopped = (
                supervisor.estop().rigs if rig_name is None else [supervisor.rig(rig_name).estop()]
            )
    except (ClientError, CliError) as error:
        # Without a key, or with one that is not valid, there are other ways.
        trouble.append(str(error))
    else:
        ways = {one.rig: SUPERVISOR for one in stopped}
        if rig_name is None and file.rig.name not in ways:
            # Its file leads to a supervisor that does not serve it; it may be up all the same.
            ways |= trip_past_supervisor(file, file.rig.name).ways
        _report_stop(form, ways, begin, rig_name)
        return
    tripped = trip_past_supervisor(file, rig_name)
    if tripped.missing:
        others = f"; stopped: {', '.join(tripped.ways)}" if tripped.ways else ""
        raise CliError(
            f"rig {', '.join(tripped.missing)} could not be stopped from here: take the "
            f"amplifier's power away unless you know that the rig is not up{others}:\n  "
            + "\n  ".join([*trouble, *tripped.trouble])
        )
    _report_stop(form, tripped.ways, begin, rig_name)


def _report_stop(form: Json, ways: Mapping[str, str], begin: float, only: str | None) -> None:
    elapsed_ms = 1e3 * (monotonic() - begin)
    lines = [f"rig {rig}: stopped {way}" for rig, way in ways.items()]
    every = "every rig is" if only is None else f"rig {only} is"
    lines += [f"{every} stopped, in {elapsed_ms:.0f} ms; `pincette reset` clears the latch"]
    form.answer({"stopped": dict(ways), "elapsed_ms": round(elapsed_ms, 1)}, "\n".join(lines))


@command(app, "reset")
def reset(target: Target) -> None:
    """Acknowledge the cause and clear the latch."""
    rig = target.rig()
    answer, cause = cleared(rig)
    target.answer(answer, f"rig {rig.name}: reset; the cause was: {cause}")


def cleared(rig: "RigHandle") -> "tuple[Stopped, str]":
    """Clear the latch of a rig, once its arm has come to rest; the answer, and the cause."""
    deadline = monotonic() + RAMP_S
    state = rig.state()
    while state.latch.state == "ramping" and monotonic() < deadline:
        sleep(LOOK_S)
        state = rig.state()
    return rig.reset(), state.latch.words or state.latch.cause or "none"


@dataclass(slots=True)
class Tripped:
    """Rigs with the way on which they were stopped, and what went wrong on the others."""

    ways: dict[str, str] = field(default_factory=dict[str, str])
    missing: list[str] = field(default_factory=list[str])
    trouble: list[str] = field(default_factory=list[str])


def trip_past_supervisor(file: "RigFile", only: str | None) -> Tripped:
    """Stop a rig, or without a name that of the file and every other one on its router."""
    from concurrent.futures import ThreadPoolExecutor

    from pincette.bus.endpoints import direct_endpoint, tool_endpoint
    from pincette.security.identity import SecurityError

    tripped, own = Tripped(), file.rig.name
    try:
        beside, ends = direct_endpoint(file, ACTUATOR), tool_endpoint(file)
    except SecurityError as error:
        return Tripped(missing=[only or own], trouble=[str(error)])
    if only in (None, own):
        _ask(own, STRAIGHT, beside, tripped)
    wanted = {own if only is None else only}
    if only is None:
        wanted |= _on_router(own, ends, tripped)
    left = wanted - tripped.ways.keys()
    if left:
        with ThreadPoolExecutor(len(left)) as threads:
            for rig in left:
                threads.submit(_ask, rig, ROUTED, ends, tripped)
    tripped.missing = sorted(wanted - tripped.ways.keys())
    return tripped


def _on_router(rig: str, ends: "SessionConfig", tripped: Tripped) -> set[str]:
    """Names of the rigs on the router whose actuator is there."""
    found: set[str] = set()

    def look(bus: "ZenohBus") -> None:
        found.update(name for name, program in bus.alive_everywhere() if program == ACTUATOR)

    _on_bus(rig, ends, tripped, look)
    return found


def _ask(rig: str, way: str, ends: "SessionConfig", tripped: Tripped) -> None:
    from pincette.core.faults import Cause
    from pincette.core.messages import Trip
    from pincette.core.topics import TRIP

    def ask(bus: "ZenohBus") -> None:
        bus.call(TRIP, Trip(Cause.ESTOP), ASK_S)
        tripped.ways[rig] = way

    _on_bus(rig, ends, tripped, ask)


def _on_bus(
    rig: str, ends: "SessionConfig", tripped: Tripped, what: "Callable[[ZenohBus], None]"
) -> None:
    """Do something on a bus, and note if it cannot be joined or nothing answers."""
    from pincette.bus.protocol import BusError
    from pincette.bus.topology import address_of
    from pincette.bus.zenoh_bus import ZenohBus

    place = ends.connect[0]
    try:
        # A port that nobody has refuses at once; the bus would go on trying for seconds.
        with create_connection(address_of(place), CONNECT_S):
            bus = ZenohBus(ends, rig, "estop")
    except OSError:
        tripped.trouble.append(f"nobody listens at {place}")
        return
    except BusError as error:
        tripped.trouble.append(str(error))
        return
    try:
        what(bus)
    except BusError as error:
        tripped.trouble.append(f"{place}: {error}")
    finally:
        bus.close()


COLOURS = {"alarm": "red", "warning": "yellow"}
ENDS = {"reset": "until the rig is reset", "condition": "still so", "acknowledge": ""}

alarms_app = group("alarms", "list the alarms of the rigs, or acknowledge one; nothing moves")
app.add_typer(alarms_app)


@command(alarms_app, "list")
def list_alarms(
    target: Target,
    limit: Limit = 50,
    before: Annotated[
        int | None, Option("--before", metavar="ID", help="begin below this id")
    ] = None,
    every: Annotated[bool, Option("--all", help="also those that are over and seen")] = False,
) -> None:
    """List alarms that are open, the newest first."""
    only = None if every else True
    found = target.supervisor().alarms(limit, rig=target.rig_name, open=only, before=before)
    none = "no alarm yet" if every else "no alarm is open; --all lists those of before"
    target.answer(found, (lambda: _show_alarms(found)) if found.alarms else none)


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


@command(alarms_app, "acknowledge")
def acknowledge(
    target: Target,
    ids: Annotated[list[int] | None, Argument(metavar="ID", help="all if none is given")] = None,
) -> None:
    """Say that you have seen an alarm, or all that are open."""
    supervisor = target.supervisor()
    wanted = ids or []
    if not wanted:
        found = supervisor.alarms(500, rig=target.rig_name, open=True).alarms
        wanted = [one.id for one in found if one.acknowledged_at is None]
    seen = [supervisor.acknowledge(number) for number in wanted]
    lines = "\n".join(f"alarm {one.id}: {state(one)}" for one in seen)
    target.answer(seen, lines, "no alarm waits to be acknowledged")


def state(one: "Alarm") -> str:
    """What an alarm still waits for, or who has seen it."""
    seen = f"seen by {one.acknowledged_by}" if one.acknowledged_at else "not acknowledged"
    ends = ENDS[one.clears] if one.cleared_at is None else ""
    return f"{seen}, {ends}" if ends else seen
