"""What a request says about itself: who sends it, and the key and the revision it goes with."""

import re
from typing import Annotated

from fastapi import Depends, Header, Request
from starlette.datastructures import Headers
from starlette.types import Scope

from pincette_supervisor.rest.guard import caller_of, gate_of

OPERATOR_LENGTH, KEY_LENGTH = 80, 255
PRINTABLE = r"^[ -~]+$"
_TAG = re.compile(r'(?:W/)?"([^"]*)-([0-9]{1,18})"')


def label_of(scope: Scope) -> str:
    """What a request says of its sender, as far as it is legible; empty: nothing."""
    label = Headers(scope=scope).get("x-operator", "")[:OPERATOR_LENGTH]
    return label if label.isprintable() and label.strip() else ""


def sender(request: Request) -> str:
    """Whose a request is: the name of its key, else what it says itself, else its address.

    An emergency stop is refused for no label, so it takes whatever the header says.
    """
    return caller_of(request.scope, gate_of(request)).signed(label_of(request.scope))


def _who(
    request: Request,
    x_operator: Annotated[
        str | None,
        Header(
            description="who asks, kept with the action; where there are keys, a label beside the "
            "name of the key",
            min_length=1,
            max_length=OPERATOR_LENGTH,
            pattern=PRINTABLE,
        ),
    ] = None,
) -> str:
    """The name of the key and the header ``X-Operator``; without either the address."""
    return caller_of(request.scope, gate_of(request)).signed(x_operator or "")


Who = Annotated[str, Depends(_who)]

Key = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        description="the same key and request create one job, however often they are sent",
        min_length=1,
        max_length=KEY_LENGTH,
        pattern=PRINTABLE,
    ),
]

IfNoneMatch = Annotated[
    str | None, Header(description="answer 304 where the job still has this ETag")
]


def etag(job: str, revision: int) -> str:
    """The ETag of a job; weak, since progress does not change it."""
    return f'W/"{job}-{revision}"'


def matched_revision(job: str, header: str | None) -> int | None:
    """The revision of a job that an ``If-None-Match`` names; None where it names none."""
    for name, revision in _TAG.findall(header or ""):
        if name == job:
            return int(revision)
    return None
