"""Access lists of the router and of each service, enforced on their links by certificate names."""

# The router's list covers messages that pass the router; a service that others reach directly has
# its own list. Everything that no rule allows is denied, also to certificates that the list does
# not name. With the opposite default, a put on a wildcard key would bypass every rule that denies.

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pincette.core.service import Participant, member_services
from pincette.core.topics import NAMESPACE, TRIP, key, request_key
from pincette.security.identity import (
    OPERATOR,
    PEOPLE,
    ROUTER,
    ROUTERS,
    SUPERVISOR,
    Identity,
    program,
)
from pincette.security.rights import EVERY_TOKEN, EVERY_TOPIC, Rights, may_ask, rights, united

Flow = Literal["ingress", "egress"]
LOOKS = ("liveliness_query", "declare_liveliness_subscriber")
ANSWERS = ("declare_queryable", "reply")


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule for one direction of a link: kinds of messages on some keys."""

    flow: Flow
    messages: tuple[str, ...]
    keys: tuple[str, ...]


Access = Mapping[str, tuple[Rule, ...]]
"""Rules of one node, by the name in the certificate of the other end."""


def router_access(identities: Iterable[Identity]) -> Access:
    """Return the messages that a router passes from and to each identity that it knows."""
    return {one.name: _of_router(rights(one)) for one in identities if one.role not in ROUTERS}


def neighbour_access(router: Identity, beyond: Iterable[Identity]) -> Access:
    """Return the messages that a router passes from and to another router, for all identities
    beyond it.
    """
    return {router.name: _of_router(united(map(rights, beyond)))}


def beyond_upstream(
    known: Iterable[Identity], rig: str, *, served_upstream: bool
) -> tuple[Identity, ...]:
    """Return the identities beyond a server's router: people, and the server's programs if
    ``served_upstream``.
    """
    served = {SUPERVISOR, program("recorder", rig).name} if served_upstream else set[str]()
    return tuple(one for one in known if one.role in PEOPLE or one.name in served)


def beyond_rig(
    known: Iterable[Identity], rig: str, *, served_upstream: bool
) -> tuple[Identity, ...]:
    """Return the identities beyond a rig's router, as seen from a laboratory server's router."""
    known = tuple(known)
    other = {
        one.name
        for one in beyond_upstream(known, rig, served_upstream=served_upstream)
        if one.role not in PEOPLE
    }
    own = (one for one in known if one.rig in ("", rig) and one.role not in ROUTERS)
    return tuple(one for one in own if one.name not in other)


def _of_router(own: Rights) -> tuple[Rule, ...]:
    return (
        _in(("put",), own.publishes),
        _in(ANSWERS, own.publishes + own.answers),
        _in(("declare_subscriber",), own.hears),
        _in(("query",), own.hears + own.asks),
        _in(("liveliness_token",), own.lives),
        _in(LOOKS, own.sees),
        _out(("put",), own.hears),
        _out(ANSWERS, own.hears + own.asks),
        _out(("declare_subscriber",), EVERY_TOPIC if own.publishes else ()),
        _out(("query",), own.answers + (EVERY_TOPIC if own.publishes else ())),
        _out(("liveliness_token",), own.sees),
        _out(LOOKS, (EVERY_TOKEN,) if own.lives else ()),
    )


def service_access(
    service: Participant, rig: str, partners: Mapping[str, Participant], operators: Collection[str]
) -> Access:
    """Return the messages that the links of a loop program admit; from a partner, inputs of its
    steps.

    ``operators`` and the supervisor may trip the actuator without the router.
    """
    own = program(service.name, rig)
    lists: dict[str, tuple[Rule, ...]] = {ROUTER: _from_router(rights(own))}
    for name, partner in partners.items():
        lists[program(name, rig).name] = _from_partner(service, partner, rig)
    asked = tuple(request_key(rig, one) for one in service.requests if may_ask(OPERATOR, one))
    for name in operators:
        lists[name] = (_in(("query",), asked), _out(ANSWERS, asked))
    stops = tuple(request_key(rig, one) for one in service.requests if one == TRIP)
    if stops:
        lists[SUPERVISOR] = (_in(("query",), stops), _out(ANSWERS, stops))
    return lists


def _from_router(own: Rights) -> tuple[Rule, ...]:
    return (
        _in(("declare_subscriber",), EVERY_TOPIC),
        _in(("query",), (*EVERY_TOPIC, *own.answers)),
        _in(("liveliness_token",), own.sees),
        _in(LOOKS, (EVERY_TOKEN,)),
        _out(("put",), own.publishes),
        _out(ANSWERS, own.publishes + own.answers),
        _out(("liveliness_token",), own.lives),
        _out(LOOKS, own.sees),
    )


def _from_partner(service: Participant, partner: Participant, rig: str) -> tuple[Rule, ...]:
    taken, given = _between(partner, service, rig), _between(service, partner, rig)
    here, there = (rights(program(one.name, rig)) for one in (service, partner))
    return (
        _in(("put",), taken),
        _in(("declare_subscriber",), given),
        _in(("liveliness_token",), there.lives),
        _in(LOOKS, there.sees),
        _out(("put",), given),
        _out(("declare_subscriber",), taken),
        _out(("liveliness_token",), here.lives),
        _out(LOOKS, here.sees),
    )


def _between(giver: Participant, taker: Participant, rig: str) -> tuple[str, ...]:
    """Return the keys that one program receives from another."""
    given = member_services(giver.name)
    wanted = {item.topic for item in taker.inputs if item.topic.producer in given}
    return tuple(sorted(key(rig, topic) for topic in wanted))


def client_access(server: Identity) -> Access:
    """Return the messages that a client's link admits: everything from and to its server only."""
    every = (f"{NAMESPACE}/**",)
    messages = ("put", "declare_subscriber", "query", *ANSWERS, "liveliness_token", *LOOKS)
    return {server.name: (_in(messages, every), _out(messages, every))}


def as_settings(access: Access) -> dict[str, Any]:
    """Return the list in the format of Zenoh's configuration."""
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for name, granted in access.items():
        named = [(f"{name} {place}", rule) for place, rule in enumerate(granted) if rule.keys]
        policies.append({"id": name, "subjects": [name], "rules": [one for one, _ in named]})
        rules += [
            {
                "id": one,
                "permission": "allow",
                "flows": [rule.flow],
                "messages": list(rule.messages),
                "key_exprs": list(dict.fromkeys(rule.keys)),
            }
            for one, rule in named
        ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in access],
        "policies": policies,
    }


def _in(messages: tuple[str, ...], keys: tuple[str, ...]) -> Rule:
    return Rule("ingress", messages, keys)


def _out(messages: tuple[str, ...], keys: tuple[str, ...]) -> Rule:
    return Rule("egress", messages, keys)
