"""Links where the rig file composes services: one for each pair of programs that share a topic."""

from itertools import combinations

import pytest

from pincette.bus.topology import awaited, consumers, peer_session, producers
from pincette.config import read_rig
from pincette.core.service import member_services
from pincette.core.topics import COMMAND, ESTIMATE, LOOP, POSITION
from pincette.engine.process import loop_programs, loop_services
from tests.support.partitions import Programs, composing, partitions
from tests.support.rigs import DEMO

RIG = read_rig(DEMO)
SERVICES = loop_services()
HOST, PORT = "127.0.0.1", 7000
AT = {f"tcp/{HOST}:{PORT + 1 + place}": name for place, name in enumerate(LOOP)}


def takes(taker: str, giver: str, *, lockstep: bool) -> bool:
    """Return whether a service of one program receives what one of another publishes."""
    wanted = {
        name
        for one in member_services(taker)
        for name in producers(SERVICES[one], lockstep=lockstep)
    }
    return not wanted.isdisjoint(member_services(giver))


@pytest.mark.parametrize("lockstep", [False, True])
@pytest.mark.parametrize("composed", partitions(), ids=" and ".join)
def test_every_pair_that_shares_a_topic_has_exactly_one_link(
    composed: Programs, lockstep: bool
) -> None:
    rig = composing(RIG, *composed)
    programs = loop_programs(rig)
    links: list[frozenset[str]] = []
    listening: list[str] = []
    for name in programs:
        ends = peer_session(HOST, PORT, name, programs, lockstep=lockstep)
        assert ends.connect[0] == f"tcp/{HOST}:{PORT}"
        links += [frozenset({name, rig.program_of(AT[place])}) for place in ends.connect[1:]]
        listening += [AT[place] for place in ends.listen]
    wanted = {
        frozenset({one, other})
        for one, other in combinations(programs, 2)
        if takes(one, other, lockstep=lockstep) or takes(other, one, lockstep=lockstep)
    }
    assert set(links) == wanted
    assert len(links) == len(wanted)
    assert sorted(listening) == sorted(LOOP), "each other service must keep its address"
    for name in programs:
        assert consumers(name, programs, lockstep=lockstep) == {
            other for other in programs if other != name and takes(other, name, lockstep=lockstep)
        }


def test_a_composed_loop_has_a_link_to_the_router_only_and_nothing_waits_for_the_loop() -> None:
    programs = loop_programs(composing(RIG, "loop"))
    ends = peer_session(HOST, PORT, "loop", programs, lockstep=True)
    assert ends.connect == (f"tcp/{HOST}:{PORT}",)
    assert awaited("loop", programs, lockstep=True) == set()


def test_programs_wait_for_the_services_that_others_contain() -> None:
    programs = loop_programs(composing(RIG, "sensor+estimator"))
    assert awaited("sensor+estimator", programs, lockstep=False) == {POSITION, ESTIMATE}
    programs = loop_programs(composing(RIG, "estimator+controller"))
    assert awaited("estimator+controller", programs, lockstep=False) == {COMMAND}
