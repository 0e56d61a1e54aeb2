"""Access lists follow from the topics: each program may publish what the topics state that it
produces."""

from itertools import combinations, product

import pytest

from pincette.bus.topology import partners
from pincette.core.topics import (
    COMMAND,
    LOOP,
    REQUESTS,
    TOPICS,
    TRIP,
    Topic,
    key,
    keys_of,
    live_key,
    request_key,
)
from pincette.engine.process import loop_services
from pincette.security.access import (
    Access,
    Rule,
    as_settings,
    client_access,
    router_access,
    service_access,
)
from pincette.security.identity import OF_A_RIG, person, program, programs_of
from pincette.security.rights import Rights, may_ask, rights

from .listed import lets

SERVICES = loop_services()
VIEWER, OPERATOR = person("anna", "viewer"), person("otto", "operator")
ROUTER, SUPERVISOR = program("router", ""), program("supervisor", "")
PROGRAMS = (*programs_of("left"), *programs_of("right"))
EVERYBODY = (SUPERVISOR, *PROGRAMS, VIEWER, OPERATOR)
AT_ROUTER = router_access([ROUTER, *EVERYBODY])
PLACES = [place for topic in TOPICS for place in keys_of("left", topic).values()]


def list_of(name: str, *, lockstep: bool = False) -> Access:
    linked = {one: SERVICES[one] for one in partners(name, SERVICES, lockstep=lockstep)}
    return service_access(SERVICES[name], "left", linked, [OPERATOR.name])


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_the_router_accepts_a_topic_from_its_producer_only(topic: Topic) -> None:
    for producer, wanted in keys_of("left", topic).items():
        say = {who.name for who in EVERYBODY if lets(AT_ROUTER, who, "ingress", "put", wanted)}
        assert say == {
            who.name for who in EVERYBODY if who.rig in ("", "left") and who.role == producer
        }
        assert say


@pytest.mark.parametrize(
    "wildcard", ["pincette/v2/left/*", "pincette/v2/*/command", "**", "pincette/**"]
)
def test_a_put_on_a_wildcard_is_never_admitted(wildcard: str) -> None:
    for who, access in [
        *product(EVERYBODY, [AT_ROUTER]),
        *product(EVERYBODY, [list_of(name) for name in LOOP]),
    ]:
        assert not lets(access, who, "ingress", "put", wildcard)
        assert not lets(access, who, "ingress", "delete", key("left", COMMAND))


def test_only_the_supervisor_may_send_every_request() -> None:
    for who, question in product(EVERYBODY, REQUESTS):
        wanted = request_key("left", question)
        allowed = lets(AT_ROUTER, who, "ingress", "query", wanted)
        assert allowed == may_ask(who.role, question), (who, question)
    assert {q.name for q in REQUESTS if may_ask("viewer", q)} == {"status", "rig_file"}
    moving = {q.name for q in REQUESTS if may_ask("operator", q)} - {"status", "rig_file"}
    assert moving == {"trip", "sim_command"}
    assert not any(may_ask(name, question) for name, question in product(OF_A_RIG, REQUESTS))


def test_a_query_on_a_wildcard_reaches_no_request() -> None:
    for who in (VIEWER, OPERATOR, *PROGRAMS):
        for wildcard in ("pincette/v2/left/**", "pincette/v2/left/call/*/*", "**"):
            assert not lets(AT_ROUTER, who, "ingress", "query", wildcard)


def test_replies_come_only_from_the_requested_program() -> None:
    for who, question in product(PROGRAMS, REQUESTS):
        answers = lets(AT_ROUTER, who, "ingress", "reply", request_key("left", question))
        assert answers == (who == program(question.service, "left"))


def test_a_program_can_hold_only_its_own_token() -> None:
    for who, other in product(PROGRAMS, PROGRAMS):
        token = live_key(other.rig, other.role)
        assert lets(AT_ROUTER, who, "ingress", "liveliness_token", token) == (who == other)
    assert not lets(AT_ROUTER, VIEWER, "ingress", "liveliness_token", live_key("left", "sensor"))


def test_viewers_may_receive_messages_of_all_rigs_and_a_rig_only_its_own() -> None:
    for topic, rig in product(TOPICS, ("left", "right")):
        for message, flow in (("declare_subscriber", "ingress"), ("put", "egress")):
            assert lets(AT_ROUTER, VIEWER, flow, message, key(rig, topic))
            recorder = lets(AT_ROUTER, program("recorder", "left"), flow, message, key(rig, topic))
            assert recorder == (rig == "left")
            assert not lets(
                AT_ROUTER, program("controller", "left"), flow, message, key(rig, topic)
            )


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_service_receives_from_its_peers_what_its_step_needs(lockstep: bool) -> None:
    for name in LOOP:
        access = list_of(name, lockstep=lockstep)
        for topic in TOPICS:
            say = {
                who.name
                for who in (ROUTER, *EVERYBODY)
                if lets(access, who, "ingress", "put", key("left", topic))
            }
            taken = any(item.topic == topic for item in SERVICES[name].inputs)
            direct = topic.producer in partners(name, SERVICES, lockstep=lockstep)
            assert say == ({f"left/{topic.producer}"} if taken and direct else set())


def test_messages_that_one_program_may_send_are_those_that_the_other_may_receive() -> None:
    for one, other in combinations(LOOP, 2):
        here, there = list_of(one, lockstep=True), list_of(other, lockstep=True)
        ours, theirs = program(one, "left"), program(other, "left")
        assert (theirs.name in here) == (ours.name in there)
        for wanted, message in product(PLACES, ("put", "declare_subscriber")):
            assert lets(here, theirs, "egress", message, wanted) == lets(
                there, ours, "ingress", message, wanted
            )


def test_the_access_lists_of_router_and_service_permit_the_same_messages() -> None:
    for name in LOOP:
        access, who = list_of(name), program(name, "left")
        for wanted in PLACES:
            allowed = lets(access, ROUTER, "egress", "put", wanted)
            assert allowed == lets(AT_ROUTER, who, "ingress", "put", wanted)
        for question in REQUESTS:
            wanted = request_key("left", question)
            allowed = lets(access, ROUTER, "ingress", "query", wanted)
            assert allowed == lets(AT_ROUTER, who, "egress", "query", wanted)


def test_without_the_router_operators_send_their_requests_and_the_supervisor_trips() -> None:
    for name, who in product(LOOP, EVERYBODY):
        granted = list_of(name).get(who.name, ())
        linked = {f"left/{other}" for other in partners(name, SERVICES, lockstep=False)}
        questions = [one for one in SERVICES[name].requests if may_ask("operator", one)]
        if who == OPERATOR:
            requested = {one for rule in granted if "query" in rule.messages for one in rule.keys}
            assert requested == {request_key("left", one) for one in questions}
        elif who == SUPERVISOR:
            requested = {one for rule in granted for one in rule.keys}
            assert requested == ({request_key("left", TRIP)} if name == "actuator" else set())
        elif who.name not in linked:
            assert granted == ()


def test_a_client_receives_only_from_its_target() -> None:
    access = client_access(ROUTER)
    assert lets(access, ROUTER, "ingress", "put", key("left", COMMAND))
    assert list(access) == [ROUTER.name]


def test_settings_deny_by_default_and_name_every_rule_once() -> None:
    tree = as_settings(
        {"left/sensor": (Rule("ingress", ("put",), ("a/b",)), Rule("egress", ("put",), ()))}
    )
    assert tree["default_permission"] == "deny"
    assert tree["enabled"] is True
    (rule,) = tree["rules"]
    assert rule["permission"] == "allow"
    assert tree["policies"] == [
        {"id": "left/sensor", "subjects": ["left/sensor"], "rules": [rule["id"]]}
    ]
    whole = as_settings(AT_ROUTER)
    ids = [rule["id"] for rule in whole["rules"]]
    assert len(ids) == len(set(ids))
    assert sorted(ids) == sorted(one for policy in whole["policies"] for one in policy["rules"])
    assert {rule["permission"] for rule in whole["rules"]} == {"allow"}


def test_a_router_has_no_rights_to_publish_or_request() -> None:
    assert rights(ROUTER) == Rights()
