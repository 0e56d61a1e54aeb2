"""Links follow from the topics: one for each pair of services that share one."""

from itertools import combinations

import pytest

from pincette.bus.topology import address_of, consumers, endpoint, peer_session, producers
from pincette.core.topics import LOOP
from pincette.engine.process import loop_services

SERVICES = loop_services()


@pytest.mark.parametrize("lockstep", [False, True])
def test_every_pair_that_shares_a_topic_has_exactly_one_link(lockstep: bool) -> None:
    links: list[frozenset[str]] = []
    for name in LOOP:
        ends = peer_session("127.0.0.1", 7000, name, SERVICES, lockstep=lockstep)
        for other in LOOP:
            if endpoint("127.0.0.1", 7000, other) in ends.connect:
                links.append(frozenset({name, other}))
    wanted = {
        frozenset(pair)
        for pair in combinations(LOOP, 2)
        if pair[0] in producers(SERVICES[pair[1]], lockstep=lockstep)
        or pair[1] in producers(SERVICES[pair[0]], lockstep=lockstep)
    }
    assert set(links) == wanted
    assert len(links) == len(wanted)


def test_every_program_has_a_link_to_the_router() -> None:
    for name in LOOP:
        ends = peer_session("127.0.0.1", 7000, name, SERVICES, lockstep=False)
        assert ends.connect[0] == "tcp/127.0.0.1:7000"
        assert ends.mode == "peer"


def test_the_pace_program_has_links_in_lockstep_only() -> None:
    assert consumers("actuator", SERVICES, lockstep=False) == {"estimator"}
    assert consumers("actuator", SERVICES, lockstep=True) == {"estimator", "sensor"}


def test_a_rig_that_joins_a_router_has_its_own_links_and_that_router() -> None:
    ends = peer_session(
        "127.0.0.1", 7100, "controller", SERVICES, lockstep=False, router_at=("bench", 7000)
    )
    assert ends.connect == ("tcp/bench:7000", "tcp/127.0.0.1:7102")
    assert ends.listen == ("tcp/127.0.0.1:7103",)
    assert address_of(ends.connect[0]) == ("bench", 7000)
