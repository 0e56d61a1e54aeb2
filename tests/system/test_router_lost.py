"""The router dies and restarts; T = 20 ms.

The links of the loop are direct, so the loop itself is not affected. The supervisor receives
nothing, and its lease ends: the controller then stops on its own.
"""

from collections.abc import Generator
from contextlib import contextmanager
from itertools import pairwise
from time import monotonic, sleep

import pytest

from pincette.bus.topology import direct_session
from pincette.bus.zenoh_bus import ZenohBus
from pincette.config.reading import laid_over
from pincette.core.messages import Applied, Message
from pincette.core.topics import APPLIED, Topic
from tests.support.grips import SHORT, approach, hold, kill, make_ready, restart, whole_grip
from tests.support.rigs import Tree, demo_rig
from tests.support.running import RunningRig, running_rig
from tests.support.witness import Witness

pytestmark = pytest.mark.usefixtures("stalls", "ready")

LEASE_S = 1.2
"""Duration of the lease, so short that the arm of a slow approach is still far from the part
when it ends."""
SHORT_LEASE: Tree = {"safety": {"lease_s": LEASE_S}}
BRIEF_S, LONG_S = 0.5, LEASE_S + 2.0
"""Times for which the router is down: shorter and longer than the lease."""
RECONNECT_S = 5.0
SETTLED_S = 1.0
"""Longest time of a controlled stop of the free arm, in s."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    own = demo_rig(laid_over(SHORT, SHORT_LEASE))
    with running_rig(own, tmp_path_factory.mktemp("rig")) as running:
        yield running


class Direct:
    """Receives the actuator's messages without the router."""

    def __init__(self, bus: ZenohBus) -> None:
        self.heard: list[tuple[float, Applied]] = []
        bus.subscribe(APPLIED, self._take)

    def _take(self, _topic: Topic, message: Message) -> None:
        assert isinstance(message, Applied)
        self.heard.append((monotonic(), message))

    def since(self, since_s: float) -> list[tuple[float, Applied]]:
        return [(at, echo) for at, echo in self.heard if at >= since_s]


@contextmanager
def beside_the_router(rig: RunningRig) -> Generator[Direct]:
    place = direct_session(rig.rig.bus.host, rig.rig.bus.port, "actuator")
    bus = ZenohBus(place, rig.rig.rig.name, "direct")
    try:
        yield Direct(bus)
    finally:
        bus.close()


def seen_again(rig: RunningRig, timeout_s: float) -> float:
    """Return the seconds until the supervisor receives messages of every program of the loop
    again."""
    begun = monotonic()
    while monotonic() < begun + timeout_s:
        programs = rig.view()["programs"]
        if all(program["trouble"] == "" for program in programs):
            return monotonic() - begun
        sleep(0.05)
    raise TimeoutError(f"not seen again: {rig.view()['reasons']}")


def away(rig: RunningRig, for_s: float) -> tuple[float, float]:
    """Kill the router and start it again later; returns when it died, and the time until all
    links were back."""
    killed_s = kill(rig, "router")
    sleep(for_s)
    restart(rig, "router")
    return killed_s, seen_again(rig, 2.0 * RECONNECT_S)


def test_the_loop_continues_without_a_router_and_all_programs_reconnect_within_five_seconds(
    rig: RunningRig, seen: Witness, figures: list[str]
) -> None:
    job = hold(rig, seen)
    with beside_the_router(rig) as direct:
        killed_s, back_s = away(rig, BRIEF_S)
        echoes = direct.since(killed_s)
    figures.append(f"router killed: all are seen again {back_s:.1f} s after it is back")
    assert back_s <= RECONNECT_S
    period_s = rig.rig.rig.period_s
    until_s = killed_s + min(BRIEF_S, LEASE_S)
    for at, echo in echoes:
        if at <= until_s:
            assert echo.state == "armed"
            assert echo.answered, f"no command was accepted for {echo.seq}"
    assert len([at for at, _ in echoes if at <= until_s]) >= 0.8 * BRIEF_S / period_s
    make_ready(rig)
    assert rig.job(job)["state"] in ("failed", "stopped", "aborted", "succeeded")
    whole_grip(rig, seen)


def test_without_a_router_the_free_arm_comes_to_rest_and_stays_there(
    rig: RunningRig, seen: Witness, figures: list[str]
) -> None:
    """The lease ends the motion; when the router is back nothing continues automatically."""
    job = approach(rig, seen)
    with beside_the_router(rig) as direct:
        killed_s, back_s = away(rig, LONG_S)
        ended = rig.ended(job)
        sleep(SETTLED_S)
        echoes = direct.since(killed_s)
    moved_s = [
        at
        for (_, one), (at, other) in pairwise(echoes)
        if one.arms[0].voltage_V != other.arms[0].voltage_V
    ]
    rest_s = max(moved_s, default=killed_s) - killed_s
    figures.append(
        f"router killed, arm free: at rest {rest_s:.2f} s after, lease {LEASE_S:g} s; "
        f"seen again {back_s:.1f} s after it is back"
    )
    assert rest_s <= LEASE_S + SETTLED_S
    assert echoes[-1][1].state in ("idle", "latched")
    assert ended["state"] == "failed"
    assert "silent" in ended["cause"] or "lease" in ended["cause"]
    assert back_s <= RECONNECT_S
    make_ready(rig)
    whole_grip(rig, seen)
