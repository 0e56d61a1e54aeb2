"""Keys that a client sends, and its handling of refusals."""

import httpx
import pytest

from pincette.client import AsyncSupervisor, ProblemError, Supervisor

from . import desk
from .desk import URL, Desk

KEY = "pincette_secret"


def test_the_key_is_sent_only_in_the_header() -> None:
    transport = Desk(desk.rig(), desk.rig())
    supervisor = Supervisor(URL, key=KEY, operator="Ann", transport=transport)
    supervisor.rig("demo").state()
    (request,) = transport.asked
    assert request.headers["Authorization"] == f"Bearer {KEY}"
    assert request.headers["X-Operator"] == "Ann"
    assert KEY not in str(request.url)
    without = Desk(desk.rig())
    Supervisor(URL, transport=without).rig("demo").state()
    assert "Authorization" not in without.asked[0].headers


@pytest.mark.parametrize("key", ["", "two words", "new\nline", "ä", "x" * 201])
@pytest.mark.parametrize("kind", [Supervisor, AsyncSupervisor])
def test_an_invalid_key_is_refused_without_printing_it(
    key: str, kind: type[Supervisor] | type[AsyncSupervisor]
) -> None:
    with pytest.raises(ValueError, match="the key is not valid") as refused:
        kind(URL, key=key)
    assert not key or key not in str(refused.value)


@pytest.mark.parametrize(("status", "code"), [(401, "no-key"), (403, "scope-too-small")])
def test_a_refusal_is_reported_and_not_repeated(status: int, code: str) -> None:
    words = "this needs scope operate; key 'ann' has observe"
    transport = Desk(desk.problem(status, code, needed_scope="operate", detail=words))
    with pytest.raises(ProblemError, match="needs scope operate") as refused:
        transport.supervisor().rigs()
    assert (refused.value.status, refused.value.code) == (status, code)
    assert transport.slept_s == []


def test_the_operator_is_sent() -> None:
    session = {"keys": True, "name": "ann", "scope": "observe", "signed_in": False}
    transport = Desk(httpx.Response(200, json=session))
    assert transport.supervisor().session().scope == "observe"
    assert transport.paths() == ["GET /api/v1/session"]
