"""Unknown clients hold connections at every port of a rig over TLS: a stop still succeeds.

Real processes, real time. Each round connects to each port as fast as possible and keeps the
connections until the next round. Meanwhile the rig is stopped in each way, and a router restarts.
"""

import resource
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

import httpx
import pytest

from pincette.bus.endpoints import direct_endpoint, tool_endpoint
from pincette.bus.zenoh_bus import ZenohBus
from pincette.cli.estop import EmergencyStop
from pincette.core.faults import Cause
from pincette.core.messages import Trip
from pincette.core.topics import LOOP, TRIP
from tests.support.bare_connects import descriptors, strangers
from tests.support.certificates import folder_for
from tests.support.grips import SHORT, kill, make_ready, restart
from tests.support.rigs import demo_rig
from tests.support.running import RunningRig, running_rig

pytestmark = pytest.mark.usefixtures("stalls")

ROUND = 1000
"""Connections to each port in one round."""
STOP_S, RECONNECT_S, BACK_S = 1.0, 5.0, 30.0
"""Guaranteed times; see the fault table."""
TIMES = 5
"""Number of times that each way is tried; the longest time counts."""
MOST_FILES = 2600
"""Largest number of open files of a program with unknown connections: the HTTP server accepts
2048 at once, and closes most."""


@pytest.fixture
def rig(tmp_path: Path) -> Generator[RunningRig]:
    own = demo_rig(SHORT)
    own = own.secured(folder_for(tmp_path / "pki", own.rig.name).path)
    with running_rig(own, tmp_path) as running:
        make_ready(running, 30.0)
        yield running


@contextmanager
def held(rig: RunningRig, rounds: int) -> Generator[threading.Event]:
    """Hold every port for this many rounds, and keep the last one; set once the first is
    complete."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    ports = [rig.rig.bus.port + offset for offset in range(1 + len(LOOP))]
    standing, end = threading.Event(), threading.Event()

    def play() -> None:
        for number in range(rounds):
            with strangers([*ports, rig.rig.supervisor.port], ROUND):
                standing.set()
                end.wait(0.0 if number < rounds - 1 else None)

    thread = threading.Thread(target=play)
    thread.start()
    try:
        assert standing.wait(30.0)
        yield standing
    finally:
        end.set()
        thread.join()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def took_s(what: Callable[[], object]) -> float:
    """Return how long a call takes, in s."""
    begun_s = monotonic()
    what()
    return monotonic() - begun_s


def over_rest(rig: RunningRig) -> None:
    """Stop over a new connection; an idle one may have been closed in favour of the unknown
    clients."""
    answer = httpx.post(f"{rig.client.base_url}rigs/{rig.rig.rig.name}/estop", trust_env=False)
    assert answer.status_code == 200


def past_supervisor(rig: RunningRig) -> None:
    """Stop as ``pincette estop`` does if no supervisor replies."""
    assert EmergencyStop(rig.rig.rig.name).past_supervisor(rig.rig).missing() == []


def over_bus(rig: RunningRig) -> None:
    """Stop by the actuator's own key, in a separate session."""
    bus = ZenohBus(direct_endpoint(rig.rig, "actuator"), rig.rig.rig.name, "stop")
    bus.call(TRIP, Trip(Cause.ESTOP), STOP_S)
    bus.close()


def seen_again(rig: RunningRig) -> None:
    """Wait until a tool sees every program of the loop at the router."""
    deadline = monotonic() + 2.0 * RECONNECT_S
    bus = ZenohBus(tool_endpoint(rig.rig), rig.rig.rig.name, "tool")
    while not set(LOOP) <= bus.alive():
        assert monotonic() < deadline, f"not seen: {set(LOOP) - bus.alive()}"
        sleep(0.02)
    bus.close()


@pytest.mark.parametrize("rounds", [1, pytest.param(10, marks=pytest.mark.slow)])
def test_a_stop_succeeds_during_a_flood_of_connections_and_peers_reconnect(
    rig: RunningRig, rounds: int, figures: list[str]
) -> None:
    processes = [member.process.pid for member in rig.fleet.members.values()]
    before = {pid: descriptors(pid) for pid in processes}
    with held(rig, rounds):
        stops, most = dict.fromkeys((one.__name__ for one in WAYS), 0.0), 0
        for one in WAYS * TIMES:
            most = max(most, *map(descriptors, processes))
            stops[one.__name__] = max(stops[one.__name__], took_s(lambda one=one: one(rig)))
        kill(rig, "router")
        restart(rig, "router")
        again_s = took_s(lambda: seen_again(rig))
    figures += [
        f"{rounds} x {ROUND} strangers at each port: stopped in "
        f"{', '.join(f'{1e3 * each_s:.0f} ms {name}' for name, each_s in stops.items())}; router "
        f"back in {again_s:.2f} s; at most {most} files"
    ]
    assert max(stops.values()) < STOP_S
    assert again_s < RECONNECT_S
    assert most < MOST_FILES
    deadline = monotonic() + BACK_S
    for pid in before.keys() & {member.process.pid for member in rig.fleet.members.values()}:
        # A supervisor opens the files that it writes; unknown clients hold none of them.
        while descriptors(pid) > before[pid] + 5:
            assert monotonic() < deadline, f"{descriptors(pid)} files, {before[pid]} before"
            sleep(0.2)


WAYS = (over_rest, past_supervisor, over_bus)
