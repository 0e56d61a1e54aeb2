"""A program that composes services has all of their permissions, and no others."""

from itertools import combinations, product

import pytest

from pincette.bus.topology import partners
from pincette.config import read_rig
from pincette.core.service import member_services
from pincette.core.topics import ARM, LOOP, TOPICS, keys_of, live_key, request_key
from pincette.engine.process import loop_programs
from pincette.security.access import Access, router_access, service_access
from pincette.security.identity import Identity, program, programs_of
from pincette.security.rights import Rights, rights
from tests.support.partitions import Programs, composing, partitions
from tests.support.rigs import DEMO
from tests.unit.security.test_access import OPERATOR, ROUTER, lets

RIG = composing(read_rig(DEMO))
NAME = RIG.rig.name
COMPOSED = [one for one in partitions() if one]


def list_of(name: str, composed: Programs, *, lockstep: bool = False) -> Access:
    programs = loop_programs(composing(RIG, *composed))
    linked = {one: programs[one] for one in partners(name, programs, lockstep=lockstep)}
    return service_access(programs[name], NAME, linked, [OPERATOR.name])


@pytest.mark.parametrize("name", sorted({name for one in COMPOSED for name in one}))
def test_a_composed_program_has_the_rights_of_all_its_services(name: str) -> None:
    own = rights(program(name, NAME))
    parts = [rights(program(one, NAME)) for one in member_services(name)]
    for what in ("publishes", "answers", "asks", "hears", "lives", "sees"):
        together = {place for part in parts for place in getattr(part, what)}
        assert set(getattr(own, what)) == together, what
    assert own != Rights()
    assert own.asks == own.hears == ()


@pytest.mark.parametrize("composed", COMPOSED, ids=" and ".join)
def test_the_router_lets_a_composed_program_publish_for_its_services_only(
    composed: Programs,
) -> None:
    at_router = router_access(programs_of(NAME, composed))
    for name, other in product(composed, (*LOOP, "recorder", "rig")):
        who, own = program(name, NAME), other in member_services(name)
        published = [keys_of(NAME, topic).get(other) for topic in TOPICS]
        for place in filter(None, published):
            assert lets(at_router, who, "ingress", "put", place) == own
        assert lets(at_router, who, "ingress", "liveliness_token", live_key(NAME, other)) == own
        if other in ARM:
            requested = request_key(NAME, ARM[other])
            assert lets(at_router, who, "ingress", "reply", requested) == own
            assert not lets(at_router, who, "ingress", "query", requested)
        assert not lets(at_router, who, "ingress", "put", f"pincette/v2/{NAME}/*")
        assert not lets(at_router, who, "ingress", "put", f"pincette/v2/right/{other}")


@pytest.mark.parametrize("lockstep", [False, True])
@pytest.mark.parametrize("composed", COMPOSED, ids=" and ".join)
def test_a_program_receives_from_its_peers_what_its_steps_need(
    composed: Programs, lockstep: bool
) -> None:
    rig = composing(RIG, *composed)
    programs = loop_programs(rig)
    everybody: list[Identity] = [*programs_of(NAME, composed), *programs_of("right", composed)]
    for name in programs:
        access = list_of(name, composed, lockstep=lockstep)
        linked = partners(name, programs, lockstep=lockstep)
        for topic in TOPICS:
            say = {
                who.name
                for who in (ROUTER, *everybody)
                if any(
                    lets(access, who, "ingress", "put", wanted)
                    for wanted in keys_of(NAME, topic).values()
                )
            }
            giver = rig.program_of(topic.producer) if topic.producer in LOOP else ""
            taken = any(item.topic == topic for item in programs[name].inputs)
            assert say == ({program(giver, NAME).name} if taken and giver in linked else set())


@pytest.mark.parametrize("composed", COMPOSED, ids=" and ".join)
def test_messages_that_one_program_may_send_are_those_that_the_other_may_receive(
    composed: Programs,
) -> None:
    programs = composing(RIG, *composed).programs
    for one, other in combinations(programs, 2):
        here, there = (list_of(name, composed, lockstep=True) for name in (one, other))
        ours, theirs = program(one, NAME), program(other, NAME)
        assert (theirs.name in here) == (ours.name in there)
        places = [place for topic in TOPICS for place in keys_of(NAME, topic).values()]
        for wanted, message in product(places, ("put", "declare_subscriber")):
            assert lets(here, theirs, "egress", message, wanted) == lets(
                there, ours, "ingress", message, wanted
            )


def test_the_certificate_of_a_single_service_is_useless_if_it_is_composed() -> None:
    access = list_of("actuator", ("estimator+controller",))
    assert program("controller", NAME).name not in access
    assert program("estimator+controller", NAME).name in access


def test_the_longest_name_of_a_composed_program_fits_into_a_certificate() -> None:
    longest = max((name for one in COMPOSED for name in one), key=len)
    assert len(program(longest, "r" * 31).name) <= 64
    assert program(longest, NAME).serves
