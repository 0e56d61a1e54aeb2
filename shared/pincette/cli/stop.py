"""Emergency stop and reset from the command line."""

import argparse
from time import monotonic, sleep

from pincette.api.rig_models import Stopped
from pincette.bus.links import client_ends, direct_ends
from pincette.bus.protocol import BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli.exit_status import Exit
from pincette.cli.options import Words, addressed, does, machine, rigged
from pincette.cli.output import emit
from pincette.cli.rest import CliError, reached
from pincette.cli.rig_file import opened
from pincette.client import ClientError, Supervisor
from pincette.messages import Trip
from pincette.topics import TRIP

ESTOP = "stop the rig at once: REST first, then straight to the actuator"
RESET = "clear the latch; its cause has been seen to"
REST_S, ASK_S = 2.0, 1.0
"""How long the supervisor, and then the actuator itself, may take to answer."""
RAMP_S, LOOK_S = 3.0, 0.05
"""How long a reset waits for an arm that is on its way to the safe voltage."""


def add(word: Words) -> None:
    """Add ``estop`` and ``reset``."""
    one = machine(rigged(word("estop", ESTOP)))
    one.add_argument("--url", help="of the supervisor; as the rig file says if not given")
    does(one, estop)
    does(addressed(word("reset", RESET)), reset)


def estop(given: argparse.Namespace) -> int:
    """Trip the actuator through the supervisor, else straight, else through the router."""
    rig = opened(given.rig)
    begin = monotonic()
    address = given.url or f"http://{rig.supervisor.host}:{rig.supervisor.port}"
    trouble: list[str] = []
    try:
        with Supervisor(address, timeout_s=REST_S, patience_s=0.0) as supervisor:
            answer = supervisor.rig(rig.rig.name).estop()
    except ClientError as error:
        trouble.append(str(error))
    else:
        if answer.acknowledged:
            return _stopped(given, "through the supervisor", begin)
        trouble.append(f"the supervisor at {address}: {answer.detail}")
    for way, ends in (
        ("at the actuator", direct_ends(rig.bus.host, rig.bus.port, "actuator")),
        ("through the router", client_ends(rig.bus.host, rig.bus.port)),
    ):
        try:
            bus = ZenohBus(ends, rig.rig.name, "estop")
        except BusError:
            trouble.append(f"nobody listens at {ends.connect[0]}")
            continue
        try:
            bus.ask(TRIP, Trip("estop"), ASK_S)
        except BusError as error:
            trouble.append(f"{ends.connect[0]}: {error}")
        else:
            return _stopped(given, way, begin)
        finally:
            bus.close()
    raise CliError(
        f"rig {rig.rig.name!r} could not be stopped from here: take the amplifier's power away "
        "unless you know that the rig is not up:\n  " + "\n  ".join(trouble)
    )


def _stopped(given: argparse.Namespace, way: str, begin: float) -> int:
    elapsed_ms = 1e3 * (monotonic() - begin)
    if given.json:
        emit({"stopped": way, "elapsed_ms": round(elapsed_ms, 1)})
    else:
        print(f"stopped {way} in {elapsed_ms:.0f} ms; `pincette reset` clears the latch")
    return Exit.DONE


def reset(given: argparse.Namespace) -> int:
    """Acknowledge the cause and clear the latch."""
    supervisor = reached(given)
    names = [given.at] if given.at else [rig.name for rig in supervisor.rigs()]
    deadline = monotonic() + RAMP_S
    answers: list[Stopped] = []
    for name in names:
        rig = supervisor.rig(name)
        state = rig.state()
        while state.latch.state == "ramping" and monotonic() < deadline:
            sleep(LOOK_S)
            state = rig.state()
        answers.append(rig.reset())
        if not given.json:
            print(f"rig {name}: reset; the cause was: {state.latch.cause or 'none'}")
    if given.json:
        emit(answers)
    return Exit.DONE
