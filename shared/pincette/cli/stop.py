"""Emergency stop and reset from the command line."""

import argparse
from collections.abc import Mapping
from time import monotonic, sleep

from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, at, does, keyed, machine, rigged
from pincette.cli.output import emit
from pincette.cli.rest import CliError, key_of, operator, rig_of
from pincette.cli.rig_file import opened
from pincette.cli.tripping import trip_past_supervisor
from pincette.client import ClientError, Supervisor

ESTOP = "stop every rig at once, or one: REST first, then straight to the actuator"
RESET = "clear the latch; its cause has been seen to"
REST_S = 2.0
"""How long the supervisor may take to answer."""
RAMP_S, LOOK_S = 3.0, 0.05
"""How long a reset waits for an arm that is on its way to the safe voltage."""
SUPERVISOR = "through the supervisor"


def add(word: Words) -> None:
    """Add ``estop`` and ``reset``."""
    one = at(machine(rigged(word("estop", ESTOP))), "the only rig to stop; without it, every one")
    one.add_argument("--url", help="of the supervisor; as the rig file says if not given")
    does(keyed(one), estop)
    does(addressed(word("reset", RESET)), reset)


def estop(given: argparse.Namespace) -> int:
    """Trip the actuators through the supervisor, else straight, else through the router."""
    file = opened(given.rig)
    begin = monotonic()
    address = given.url or f"http://{file.supervisor.host}:{file.supervisor.port}"
    trouble: list[str] = []
    try:
        key = key_of(given)
        with Supervisor(
            address, timeout_s=REST_S, patience_s=0.0, operator=operator(), key=key
        ) as supervisor:
            asked = (
                supervisor.estop().rigs if given.at is None else [supervisor.rig(given.at).estop()]
            )
    except (ClientError, CliError) as error:
        # Without a key, or with one that opens nothing, there are other ways.
        trouble.append(str(error))
    else:
        ways = {answer.rig: SUPERVISOR for answer in asked}
        if given.at is None and file.rig.name not in ways:
            # Its file leads to a supervisor that does not serve it; it may be up all the same.
            ways |= trip_past_supervisor(file, file.rig.name).ways
        return _stopped(given, ways, begin)
    tripped = trip_past_supervisor(file, given.at)
    if tripped.missing:
        stopped = f"; stopped: {', '.join(tripped.ways)}" if tripped.ways else ""
        raise CliError(
            f"rig {', '.join(tripped.missing)} could not be stopped from here: take the "
            f"amplifier's power away unless you know that the rig is not up{stopped}:\n  "
            + "\n  ".join([*trouble, *tripped.trouble])
        )
    return _stopped(given, tripped.ways, begin)


def _stopped(given: argparse.Namespace, ways: Mapping[str, str], begin: float) -> int:
    elapsed_ms = 1e3 * (monotonic() - begin)
    if given.json:
        emit({"stopped": dict(ways), "elapsed_ms": round(elapsed_ms, 1)})
        return Exit.DONE
    for rig, way in ways.items():
        print(f"rig {rig}: stopped {way}")
    every = "every rig is" if given.at is None else f"rig {given.at} is"
    print(f"{every} stopped, in {elapsed_ms:.0f} ms; `pincette reset` clears the latch")
    return Exit.DONE


def reset(given: argparse.Namespace) -> int:
    """Acknowledge the cause and clear the latch."""
    rig = rig_of(given)
    deadline = monotonic() + RAMP_S
    state = rig.state()
    while state.latch.state == "ramping" and monotonic() < deadline:
        sleep(LOOK_S)
        state = rig.state()
    answer = rig.reset()
    if given.json:
        emit(answer)
    else:
        print(f"rig {rig.name}: reset; the cause was: {state.latch.cause or 'none'}")
    return Exit.DONE
