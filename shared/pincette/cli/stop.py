"""Emergency stop and reset from the command line."""

from pathlib import Path
from time import monotonic, sleep

from pincette.bus.links import client_ends, direct_ends
from pincette.bus.protocol import BusError
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli.rest import CliError, Supervisor
from pincette.cli.rig_file import opened
from pincette.messages import Trip
from pincette.topics import TRIP

REST_S, ASK_S = 2.0, 1.0
"""How long the supervisor, and then the actuator itself, may take to answer."""
RAMP_S, LOOK_S = 3.0, 0.05
"""How long a reset waits for an arm that is on its way to the safe voltage."""


def estop(rig_path: Path, url: str | None) -> int:
    """Trip the actuator through the supervisor, else straight, else through the router."""
    rig = opened(rig_path)
    begin = monotonic()
    address = url or f"http://{rig.supervisor.host}:{rig.supervisor.port}"
    trouble: list[str] = []
    try:
        answer = Supervisor(address, REST_S).post(f"/rigs/{rig.rig.name}/estop")
    except CliError as error:
        trouble.append(str(error))
    else:
        if answer["acknowledged"]:
            return _stopped("through the supervisor", begin)
        trouble.append(f"the supervisor at {address}: {answer['detail']}")
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
            return _stopped(way, begin)
        finally:
            bus.close()
    raise CliError(
        f"rig {rig.rig.name!r} could not be stopped from here: take the amplifier's power away "
        "unless you know that the rig is not up:\n  " + "\n  ".join(trouble)
    )


def _stopped(way: str, begin: float) -> int:
    elapsed_ms = 1e3 * (monotonic() - begin)
    print(f"stopped {way} in {elapsed_ms:.0f} ms; `pincette reset` clears the latch")
    return 0


def reset(url: str) -> int:
    """Acknowledge the cause and clear the latch."""
    supervisor = Supervisor(url)
    deadline = monotonic() + RAMP_S
    for found in supervisor.get("/rigs")["rigs"]:
        rig = found
        while rig["latch"]["state"] == "ramping" and monotonic() < deadline:
            sleep(LOOK_S)
            rig = supervisor.get(f"/rigs/{rig['name']}")
        cause = rig["latch"]["cause"] or "none"
        supervisor.post(f"/rigs/{rig['name']}/reset", {"acknowledge": True})
        print(f"rig {rig['name']}: reset; the cause was: {cause}")
    return 0
