"""The query that a router sends to itself gets a reply, and no tool on the bus sees it."""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from time import monotonic

import pytest

from pincette.bus.endpoints import router_endpoint
from pincette.bus.session import AskRouter, serve_router
from pincette.bus.topology import SessionConfig
from tests.support.certificates import folder_for
from tests.support.foreign import declared, outsider
from tests.support.rigs import demo_rig

ANSWER_S = 5.0
QUESTIONS = 20


@contextmanager
def router(config: SessionConfig) -> Generator[AskRouter]:
    """Run a router in a thread; yields the queries that the router receives."""
    asks: list[AskRouter] = []
    up, end = threading.Event(), threading.Event()

    def wait(ask: AskRouter) -> None:
        asks.append(ask)
        up.set()
        end.wait()

    thread = threading.Thread(target=serve_router, args=(config, "demo", wait))
    thread.start()
    try:
        assert up.wait(ANSWER_S)
        yield asks[0]
    finally:
        end.set()
        thread.join()


@pytest.mark.parametrize("patient", [False, True])
@pytest.mark.parametrize("secure", [False, True])
def test_a_router_answers_its_own_query(tmp_path: Path, *, secure: bool, patient: bool) -> None:
    rig = demo_rig()
    if secure:
        rig = rig.secured(folder_for(tmp_path / "pki", "demo").path)
    with router(replace(router_endpoint(rig), patient=patient)) as ask:
        begun_s = monotonic()
        for _ in range(QUESTIONS):
            ask()
        assert monotonic() - begun_s < ANSWER_S


@pytest.mark.parametrize("kind", ["store", "silent", "rubbish"])
def test_a_tool_that_answers_every_query_does_not_delay_the_query_of_the_router_to_itself(
    kind: str,
) -> None:
    rig = demo_rig()
    place = f"tcp/{rig.bus.host}:{rig.bus.port}"
    with (
        router(router_endpoint(rig)) as ask,
        outsider("peer", place) as session,
        declared(session, kind, "**") as tool,
    ):
        begun_s = monotonic()
        for _ in range(QUESTIONS):
            ask()
        assert monotonic() - begun_s < ANSWER_S
        assert (tool.queries, tool.newest) == (0, {})
