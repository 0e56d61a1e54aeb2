"""Two routers: each admits from the other the messages of permitted programs beyond it, and no
others."""

from itertools import product

import pytest

from pincette.bus.endpoints import (
    program_endpoint,
    router_endpoint,
    tool_endpoint,
    upstream_endpoint,
)
from pincette.bus.protocol import BusError
from pincette.config import ConfigError, RigFile
from pincette.config.reading import laid_over
from pincette.core.topics import LOOP, REQUESTS, TOPICS, keys_of, live_key, request_key
from pincette.security.access import (
    beyond_rig,
    beyond_upstream,
    neighbour_access,
    router_access,
)
from pincette.security.identity import Identity, person, program, programs_of
from tests.support.rigs import demo_rig

from .listed import lets

ROUTER, UPSTREAM = program("router", ""), program("upstream", "")
SUPERVISOR, RECORDER = program("supervisor", ""), program("recorder", "left")
PEOPLE = person("anna", "viewer"), person("otto", "operator")
KNOWN = (ROUTER, UPSTREAM, SUPERVISOR, *programs_of("left"), *programs_of("right"), *PEOPLE)


def sides(*, served_upstream: bool) -> tuple[tuple[Identity, ...], tuple[Identity, ...]]:
    return beyond_rig(KNOWN, "left", served_upstream=served_upstream), beyond_upstream(
        KNOWN, "left", served_upstream=served_upstream
    )


@pytest.mark.parametrize("served_upstream", [True, False])
def test_each_program_is_behind_one_router_and_people_may_be_behind_either(
    served_upstream: bool,
) -> None:
    rig, server = ({one.name for one in side} for side in sides(served_upstream=served_upstream))
    assert rig & server == {one.name for one in PEOPLE}
    ours = {one.name for one in KNOWN if one.rig in ("", "left")} - {"router", "upstream"}
    assert rig | server == ours
    assert (SUPERVISOR.name in server) == (RECORDER.name in server) == served_upstream


@pytest.mark.parametrize("served_upstream", [True, False])
def test_only_permitted_messages_from_an_upstream_router_reach_the_loop(
    served_upstream: bool,
) -> None:
    _, server = sides(served_upstream=served_upstream)
    at_rig = neighbour_access(UPSTREAM, server)
    for topic, rig in product(TOPICS, ("left", "right")):
        for place in keys_of(rig, topic).values():
            passes = lets(at_rig, UPSTREAM, "ingress", "put", place)
            assert passes == (served_upstream and topic.producer == "supervisor")
    each = router_access(KNOWN)
    for question in REQUESTS:
        wanted = request_key("left", question)
        passes = lets(at_rig, UPSTREAM, "ingress", "query", wanted)
        assert passes == any(lets(each, one, "ingress", "query", wanted) for one in server)
    for name in LOOP:
        assert not lets(at_rig, UPSTREAM, "ingress", "liveliness_token", live_key("left", name))


def test_a_rigs_router_may_publish_for_its_own_rig_only() -> None:
    rig, _ = sides(served_upstream=True)
    at_server = neighbour_access(ROUTER, rig)
    for topic in TOPICS:
        own = topic.producer not in ("supervisor", "recorder")
        for place in keys_of("left", topic).values():
            assert lets(at_server, ROUTER, "ingress", "put", place) == own
        for place in keys_of("right", topic).values():
            assert not lets(at_server, ROUTER, "ingress", "put", place)
    for name in LOOP:
        assert lets(at_server, ROUTER, "ingress", "liveliness_token", live_key("left", name))
        assert not lets(at_server, ROUTER, "ingress", "liveliness_token", live_key("right", name))
    for wildcard in ("pincette/**", "pincette/v2/*/command", "pincette/v2/left/*"):
        assert not lets(at_server, ROUTER, "ingress", "put", wildcard)


def test_messages_that_one_router_may_send_are_those_that_the_other_may_receive() -> None:
    rig, server = sides(served_upstream=True)
    at_rig, at_server = neighbour_access(UPSTREAM, server), neighbour_access(ROUTER, rig)
    for topic, wanted in [
        (one, place) for one in TOPICS for place in keys_of("left", one).values()
    ]:
        for message in ("put", "declare_queryable", "reply"):
            if topic.producer not in ("supervisor", "recorder"):
                assert lets(at_rig, UPSTREAM, "egress", message, wanted), (topic.name, message)
                assert lets(at_server, ROUTER, "ingress", message, wanted), (topic.name, message)
        if topic.producer != "recorder":
            assert lets(at_server, ROUTER, "egress", "declare_subscriber", wanted)
            assert lets(at_rig, UPSTREAM, "ingress", "declare_subscriber", wanted)
    for question in REQUESTS:
        wanted = request_key("left", question)
        if question.service not in ("recorder",):
            for message in ("declare_queryable", "reply"):
                assert lets(at_rig, UPSTREAM, "egress", message, wanted), question
                assert lets(at_server, ROUTER, "ingress", message, wanted), question
            assert lets(at_server, ROUTER, "egress", "query", wanted), question
            assert lets(at_rig, UPSTREAM, "ingress", "query", wanted), question


def far(**bus: str) -> RigFile:
    tree = laid_over(demo_rig().model_dump(mode="json", exclude_unset=True), {"bus": bus})
    return demo_rig({"bus": tree["bus"]})


def test_programs_are_assigned_to_their_router() -> None:
    rig = far(host="10.0.0.2", upstream="10.0.0.1:7447")
    port = rig.bus.port
    assert router_endpoint(rig).listen == (f"tcp/10.0.0.2:{port}",)
    assert router_endpoint(rig).connect == ("tcp/10.0.0.1:7447",)
    assert upstream_endpoint(rig).listen == ("tcp/10.0.0.1:7447",)
    assert upstream_endpoint(rig).connect == ()
    for place in (tool_endpoint(rig), program_endpoint(rig, "supervisor", lockstep=False)):
        assert place.connect == ("tcp/10.0.0.1:7447",)
    near = far(host="10.0.0.2", upstream="10.0.0.1:7447", served_at="rig")
    assert tool_endpoint(near).connect == (f"tcp/10.0.0.2:{near.bus.port}",)
    assert not near.bus.served_upstream


def test_a_rig_without_upstream_is_unchanged() -> None:
    rig = demo_rig()
    assert router_endpoint(rig).connect == ()
    with pytest.raises(BusError, match=r"has no \[bus\] upstream"):
        upstream_endpoint(rig)


def test_the_address_of_the_server_changes_no_digest() -> None:
    rig = demo_rig()
    above = rig.bus.model_copy(update={"upstream": "10.0.0.1:7447"})
    assert rig.model_copy(update={"bus": above}).digest() == rig.digest()


def test_a_rig_joins_another_router_or_has_one_that_connects_upstream() -> None:
    with pytest.raises(ConfigError, match="exclude each other"):
        far(router="10.0.0.3:7447", upstream="10.0.0.1:7447")
