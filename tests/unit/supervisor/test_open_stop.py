"""An emergency stop needs no key, and each of many simultaneous ones is confirmed."""

import asyncio

import httpx
import pytest

from tests.support.keys import ScopeKeys, shown

from .harness import Harness


@pytest.mark.parametrize("path", ["/api/v1/estop", "/api/v1/rigs/demo/estop"])
@pytest.mark.parametrize(
    "headers", [{}, shown("wrong"), shown("x" * 300)], ids=["none", "wrong", "odd"]
)
def test_every_client_may_stop(
    harness: Harness, ring: ScopeKeys, path: str, headers: dict[str, str]
) -> None:
    assert harness.call("GET", "/api/v1/rigs", headers=headers).status_code == 401
    answer = harness.call("POST", path, headers=headers)
    assert answer.status_code == 200
    assert len(harness.bus.trips) == 1
    (entry,) = harness.call("GET", "/api/v1/audit?limit=1", headers=ring.headers("admin")).json()[
        "entries"
    ]
    assert (entry["who"], entry["action"], entry["status"]) == ("127.0.0.1", f"POST {path}", 200)


def test_concurrent_stops_share_trips_and_each_one_is_confirmed(harness: Harness) -> None:
    """Stops that arrive during a request to the actuator share the next trip."""

    async def flood() -> list[int]:
        transport = httpx.ASGITransport(harness.app)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            requested = [client.post("/api/v1/rigs/demo/estop") for _ in range(300)]
            return [answer.status_code for answer in await asyncio.gather(*requested)]

    assert set(asyncio.run(flood())) == {200}
    assert 1 <= len(harness.bus.trips) <= 100
