"""What a request says about itself: who sends it, and the key and the revision it goes with."""

import re
from typing import Annotated

from fastapi import Depends, Header, Request

OPERATOR_LENGTH, KEY_LENGTH = 80, 255
PRINTABLE = r"^[ -~]+$"
_TAG = re.compile(r'(?:W/)?"([^"]*)"')


def sender(request: Request) -> str:
    """The name that a request gives, as far as it is legible, or its address.

    An emergency stop is refused for nothing, so it takes whatever the header says.
    """
    name = request.headers.get("x-operator", "")[:OPERATOR_LENGTH]
    if name.isprintable() and name.strip():
        return name
    return request.client.host if request.client is not None else "unknown"


def _who(
    request: Request,
    x_operator: Annotated[
        str | None,
        Header(
            description="who asks, kept with the action",
            min_length=1,
            max_length=OPERATOR_LENGTH,
            pattern=PRINTABLE,
        ),
    ] = None,
) -> str:
    """The header ``X-Operator``, or the address that the request came from."""
    return x_operator or sender(request)


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
    for tag in _TAG.findall(header or ""):
        name, _, revision = str(tag).rpartition("-")
        if name == job and revision.isdecimal():
            return int(revision)
    return None
