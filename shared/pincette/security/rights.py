"""What each identity may publish, receive, ask and answer, derived from topics and requests."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from itertools import chain

from pincette.core.service import member_services
from pincette.core.topics import (
    NAMESPACE,
    REQUESTS,
    TOPICS,
    Request,
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
"""Which questions people may ask, by name. The supervisor may ask every one, no other any."""
ANY = "*"
EVERY_TOPIC = topic_keys(ANY)
"""Key expressions of all topics of all rigs; they cover no request and no token."""
EVERY_TOKEN = live_key_of_any_wire(ANY)


@dataclass(frozen=True, slots=True)
class Rights:
    """Key expressions that one identity may use, by what it does with them."""

    tells: tuple[str, ...] = ()
    """Publishes on, and answers with the newest of."""
    answers: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    """Subscribes to, and asks for the newest of, by way of the router."""
    lives: tuple[str, ...] = ()
    """Holds its token on."""
    sees: tuple[str, ...] = ()
    """Tokens that it may look at."""


def rights(identity: Identity) -> Rights:
    """What an identity may do; a program that composes services may do what they may."""
    # A router publishes nothing of its own, and services of the loop take their inputs directly.
    role, rig = identity.role, identity.rig or ANY
    if role in ROUTERS:
        return Rights()
    published, roles = topic_keys(rig), member_services(role) or (role,)
    return Rights(
        tells=tuple(
            place
            for topic in TOPICS
            for producer, place in keys_of(rig, topic).items()
            if producer in roles
        ),
        answers=tuple(request_key(rig, one) for one in REQUESTS if one.service in roles),
        asks=tuple(request_key(rig, one) for one in REQUESTS if may_ask(role, one)),
        hears=published if role in (*PEOPLE, SUPERVISOR, "recorder") else (),
        lives=tuple(_token(rig, role) for role in roles if role in (*OF_A_RIG, SUPERVISOR)),
        sees=(live_key_of_any_wire(rig),),
    )


def united(several: Iterable[Rights]) -> Rights:
    """What any of several may do, each key expression once."""
    every = [*several]
    return Rights(
        *(
            tuple(dict.fromkeys(chain.from_iterable(getattr(one, field.name) for one in every)))
            for field in fields(Rights)
        )
    )


def may_ask(role: str, question: Request) -> bool:
    """Whether a role may ask a question."""
    return role == SUPERVISOR or question.name in ASKS.get(role, ())


def _token(rig: str, program: str) -> str:
    """Of any version of the wire, so that one that is to be updated is seen as well."""
    return f"{NAMESPACE}/*/{rig}/live/{program}"
