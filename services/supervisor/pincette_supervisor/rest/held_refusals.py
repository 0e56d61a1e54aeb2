"""Refusals that are held back from an address that has had many of them lately.

A client that repeats a refused request at once would keep the event loop busy with refusals. Held
back for a second, a refusal costs the server a timer. Accepted requests and all stops of the same
address are not delayed.
"""

import asyncio
from time import monotonic

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pincette_supervisor.access.access import TokenBuckets
from pincette_supervisor.access.authentication import Caller
from pincette_supervisor.rest.dependencies import HELD
from pincette_supervisor.rest.request_target import JOB_STOPS, estop_path

HELD_S = 1.0
"""Time for which a refusal is held back."""
PER_S, BURST = 10.0, 50.0
"""Refusals of one address that are not held back: lasting rate, and number at once."""
REFUSED = "pincette.refused"
"""Key of the ASGI scope of a request that has been refused."""
UNKNOWN = (401, 403, 429)
"""Statuses of requests that are no stop of a job, whatever their path: the sender may not stop it,
or the limits of rate and number apply."""


class Refusals:
    """Counts the refusals of each address."""

    def __init__(self, per_s: float = PER_S, burst: float = BURST) -> None:
        self._buckets = TokenBuckets(per_s, burst)

    def hold_s(self, address: str) -> float:
        """Count a refusal; return for how long it must be held back, in s."""
        client = Caller(address).network
        return HELD_S if self._buckets.wait_s(client, monotonic()) > 0.0 else 0.0


class HeldRefusals:
    """ASGI application that holds back answers with a status of 4xx.

    The request is no longer under way meanwhile: it takes no share of the limits of its client.
    """

    def __init__(self, app: ASGIApp, refusals: Refusals) -> None:
        self._app, self._refusals = app, refusals

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http" or estop_path(scope["method"], scope["path"]) is not None:
            await self._app(scope, receive, send)
            return
        refusal: list[Message] = []

        async def kept(message: Message) -> None:
            start = message["type"] == "http.response.start"
            if refusal or (start and _is_refusal(scope, message["status"])):
                scope[REFUSED] = True
                refusal.append(message)
            else:
                await send(message)

        await self._app(scope, receive, kept)
        if refusal and HELD not in scope:
            client = scope.get("client")
            hold_s = self._refusals.hold_s("" if client is None else client[0])
            if hold_s:
                scope[HELD] = True
                await asyncio.sleep(hold_s)
        for message in refusal:
            await send(message)


def _is_refusal(scope: Scope, status: int) -> bool:
    stops = scope["method"] == "POST" and scope["path"].endswith(JOB_STOPS)
    return 400 <= status < 500 and (not stops or status in UNKNOWN)
