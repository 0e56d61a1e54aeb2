"""Access lists, as the nodes hold them that enforce them.

A list is enforced by the node that has it, on its own links, by the name in the certificate at
their other end. The router's list protects what passes the router; a service that others reach
directly has a list of its own. What no rule allows is denied, also to a certificate that the list
does not name: under the opposite, a put on a wildcard would pass each rule that denies.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pincette.security.identity import OPERATOR, ROUTER, Identity, program
from pincette.security.rights import EVERY_TOKEN, EVERY_TOPIC, Rights, may_ask, rights
from pincette.service import AnyService
from pincette.topics import NAMESPACE, key, question_key

Flow = Literal["ingress", "egress"]
LOOKS = ("liveliness_query", "declare_liveliness_subscriber")
ANSWERS = ("declare_queryable", "reply")


@dataclass(frozen=True, slots=True)
class Rule:
    """What may pass a link in one direction: kinds of messages, on some keys."""

    flow: Flow
    messages: tuple[str, ...]
    keys: tuple[str, ...]


Access = Mapping[str, tuple[Rule, ...]]
"""Rules of one node, by the name in the certificate at the other end."""


def router_access(identities: Iterable[Identity]) -> Access:
    """What a router lets pass from and to each identity that it knows."""
    return {one.name: _of_router(rights(one)) for one in identities if one.role != ROUTER}


def _of_router(own: Rights) -> tuple[Rule, ...]:
    return (
        _in(("put",), own.tells),
        _in(ANSWERS, own.tells + own.answers),
        _in(("declare_subscriber",), own.hears),
        _in(("query",), own.hears + own.asks),
        _in(("liveliness_token",), own.lives),
        _in(LOOKS, own.sees),
        _out(("put",), own.hears),
        _out(ANSWERS, own.hears + own.asks),
        _out(("declare_subscriber",), (EVERY_TOPIC,) if own.tells else ()),
        _out(("query",), own.answers + ((EVERY_TOPIC,) if own.tells else ())),
        _out(("liveliness_token",), own.sees),
        _out(LOOKS, (EVERY_TOKEN,) if own.lives else ()),
    )


def service_access(
    service: AnyService, rig: str, partners: Mapping[str, AnyService], operators: Collection[str]
) -> Access:
    """What a service of the loop lets pass from and to the router, its partners, and operators.

    ``partners`` are the services that it has a direct link to. From a partner it takes what its
    step takes, and nothing from the router. ``operators`` may trip it without the router.
    """
    own = program(service.name, rig)
    lists: dict[str, tuple[Rule, ...]] = {ROUTER: _from_router(rights(own))}
    for name, partner in partners.items():
        lists[program(name, rig).name] = _from_partner(service, partner, rig)
    asked = tuple(question_key(rig, one) for one in service.questions if may_ask(OPERATOR, one))
    for name in operators:
        lists[name] = (_in(("query",), asked), _out(ANSWERS, asked))
    return lists


def _from_router(own: Rights) -> tuple[Rule, ...]:
    return (
        _in(("declare_subscriber",), (EVERY_TOPIC,)),
        _in(("query",), (EVERY_TOPIC, *own.answers)),
        _in(("liveliness_token",), own.sees),
        _in(LOOKS, (EVERY_TOKEN,)),
        _out(("put",), own.tells),
        _out(ANSWERS, own.tells + own.answers),
        _out(("liveliness_token",), own.lives),
        _out(LOOKS, own.sees),
    )


def _from_partner(service: AnyService, partner: AnyService, rig: str) -> tuple[Rule, ...]:
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


def _between(giver: AnyService, taker: AnyService, rig: str) -> tuple[str, ...]:
    """Keys of what one service takes of another."""
    wanted = {item.topic for item in taker.inputs if item.topic.producer == giver.name}
    return tuple(sorted(key(rig, topic) for topic in wanted))


def client_access(server: Identity) -> Access:
    """What a client lets pass: everything of the one it means to be connected to, else nothing."""
    every = (f"{NAMESPACE}/**",)
    messages = ("put", "declare_subscriber", "query", *ANSWERS, "liveliness_token", *LOOKS)
    return {server.name: (_in(messages, every), _out(messages, every))}


def as_settings(access: Access) -> dict[str, Any]:
    """The list in the words of Zenoh's configuration."""
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
