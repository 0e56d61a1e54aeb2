"""Permissions of each identity to publish, receive, request and reply, by topics and requests."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from itertools import chain

from pincette.core.service import member_services
from pincette.core.topics import (
    INPUTS,
    NAMESPACE,
    REQUESTS,
    TOPICS,
    Request,
    key,
    keys_of,
    live_key_of_any_wire,
    request_key,
    topic_keys,
)
from pincette.security.identity import (
    OF_A_RIG,
    OPERATOR,
    PEOPLE,
    ROUTERS,
    SUPERVISOR,
    VIEWER,
    Identity,
)

ASKS: dict[str, tuple[str, ...]] = {
    VIEWER: ("status", "rig_file"),
    OPERATOR: ("status", "rig_file", "trip", "sim_command"),
}
"""Requests that people may send, by role. The supervisor may send all requests, other programs
none."""
ANY = "*"
EVERY_TOPIC = topic_keys(ANY)
"""Key expressions of all topics of all rigs; they match no request and no token."""
EVERY_TOKEN = live_key_of_any_wire(ANY)


@dataclass(frozen=True, slots=True)
class Rights:
    """Key expressions that one identity may use, by the kind of use."""

    publishes: tuple[str, ...] = ()
    """Keys that the identity publishes, and whose newest message it returns."""
    answers: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    """Keys to which the identity subscribes through the router, and whose newest message it
    queries.
    """
    lives: tuple[str, ...] = ()
    """Key of the identity's own liveliness token."""
    sees: tuple[str, ...] = ()
    """Liveliness tokens that the identity may see."""


def rights(identity: Identity) -> Rights:
    """Return the permissions of an identity; a program of several services has those of all of
    them.
    """
    # A router publishes nothing itself, and services of the loop receive their inputs directly.
    role, rig = identity.role, identity.rig or ANY
    if role in ROUTERS:
        return Rights()
    published, roles = topic_keys(rig), member_services(role) or (role,)
    return Rights(
        publishes=tuple(
            place
            for topic in TOPICS
            for producer, place in keys_of(rig, topic).items()
            if producer in roles
        )
        + (tuple(key(rig, topic) for topic in INPUTS) if role == OPERATOR else ()),
        answers=tuple(request_key(rig, one) for one in REQUESTS if one.service in roles),
        asks=tuple(request_key(rig, one) for one in REQUESTS if may_ask(role, one)),
        hears=published if role in (*PEOPLE, SUPERVISOR, "recorder") else (),
        lives=tuple(_token(rig, role) for role in roles if role in (*OF_A_RIG, SUPERVISOR)),
        sees=(live_key_of_any_wire(rig),),
    )


def united(several: Iterable[Rights]) -> Rights:
    """Return the combined permissions of several identities, each key expression once."""
    every = [*several]
    return Rights(
        *(
            tuple(dict.fromkeys(chain.from_iterable(getattr(one, field.name) for one in every)))
            for field in fields(Rights)
        )
    )


def may_ask(role: str, question: Request) -> bool:
    """Return whether a role may send a request."""
    return role == SUPERVISOR or question.name in ASKS.get(role, ())


def _token(rig: str, program: str) -> str:
    """Return the tokens of a program for every version of the wire protocol, so that outdated
    programs are also visible.
    """
    return f"{NAMESPACE}/*/{rig}/live/{program}"
