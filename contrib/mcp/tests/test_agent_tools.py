"""An agent's emergency stop needs no key, and is reported as sent if the result cannot be read."""

import asyncio

import httpx
import pytest
from mcp.server.mcpserver.exceptions import ToolError

from pincette.api.rigs import Newest, Stopped, StoppedList
from pincette_mcp.server import Tools
from tests.unit.client.desk import Desk, example, job, problem, rig

ESTOP = "POST /api/v1/rigs/demo/estop"
ESTOP_ALL = "POST /api/v1/estop"


def stopped() -> httpx.Response:
    return httpx.Response(200, json=example(Stopped))


def all_stopped() -> httpx.Response:
    return httpx.Response(200, json=example(StoppedList))


@pytest.mark.parametrize("name", ["demo", None])
def test_a_stop_is_reported_as_sent_if_reading_requires_a_key(name: str | None) -> None:
    desk = Desk(stopped() if name else all_stopped(), problem(401, "no-key"))
    done = asyncio.run(Tools(desk.async_supervisor(), name).emergency_stop())
    assert desk.paths()[0] == (ESTOP if name else ESTOP_ALL), "the stop must be the first request"
    assert (done.part, done.detail) == ("unknown", "latched: estop")


def test_a_stop_is_reported_as_confirmed_if_the_supervisor_ends_afterwards() -> None:
    desk = Desk(stopped(), httpx.ConnectError("gone"))
    done = asyncio.run(Tools(desk.async_supervisor(), "demo").emergency_stop())
    assert (done.part, done.detail) == ("unknown", "latched: estop")
    assert desk.slept_s == [], "a confirmed stop does not wait for the supervisor"


def test_a_stop_reports_the_held_part() -> None:
    desk = Desk(stopped(), rig(part="held"))
    assert asyncio.run(Tools(desk.async_supervisor(), "demo").emergency_stop()).part == "held"


@pytest.mark.parametrize("name", ["demo", None])
def test_status_without_a_key_fails_with_the_code_no_key(name: str | None) -> None:
    desk = Desk(problem(401, "no-key"))
    with pytest.raises(ToolError, match=r"^no-key: "):
        asyncio.run(Tools(desk.async_supervisor(), name).status())


@pytest.mark.parametrize("name", ["demo", None])
def test_status_is_unknown_while_no_supervisor_replies(name: str | None) -> None:
    desk = Desk(httpx.ConnectError("gone"))
    status = asyncio.run(Tools(desk.async_supervisor(), name).status())
    assert (status.state, status.can_start) == ("unknown", False)


def test_an_unconfirmed_stop_is_an_error() -> None:
    desk = Desk(problem(503, "estop-unconfirmed"))
    with pytest.raises(ToolError, match="estop-unconfirmed"):
        asyncio.run(Tools(desk.async_supervisor(), "demo").emergency_stop())


@pytest.mark.parametrize("where", ["newest", "result"])
def test_status_states_an_invalid_zero_of_now_and_of_the_reported_job(where: str) -> None:
    invalid = {"zero_invalid": True}
    newest = example(Newest, force_mN=None, **(invalid if where == "newest" else {}))
    desk = Desk(rig(newest=newest), job(result=invalid if where == "result" else {}))
    status = asyncio.run(Tools(desk.async_supervisor(), "demo").status("20260301-120000-1f0c"))
    assert (status.zero_invalid, status.force_mN) == (True, None)
