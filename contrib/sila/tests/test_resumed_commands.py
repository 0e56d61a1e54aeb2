"""A restarted SiLA server reports the state of the rig once it knows the earlier commands."""

import asyncio
from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager
from queue import Queue
from threading import Event
from typing import Any
from uuid import UUID, uuid4

import httpx
import pytest
from sila2.server import SilaServer

from pincette.api.jobs import Job
from pincette.api.rigs import Rig
from pincette.client import AsyncSupervisor
from pincette_sila.background import Background
from pincette_sila.callers import Callers
from pincette_sila.controllers import Pausing
from pincette_sila.errors import CommandError
from pincette_sila.features import MICROGRIPPER, PAUSE_CONTROLLER, feature
from pincette_sila.gripper import Gripper
from pincette_sila.recovery import ErrorRecovery
from pincette_sila.watching import watch_rig
from tests.support.adapters import until

Reply = Callable[[], Awaitable[httpx.Response]]


def example(model: Any, **changes: Any) -> dict[str, Any]:
    """Return the example of a model, as the supervisor would send it."""
    return {**model.model_config["json_schema_extra"]["examples"][0], **changes}


def jobs_of(execution: UUID) -> httpx.Response:
    """Return a list of jobs; an earlier server has started one of them for a command."""
    job = example(Job, labels={"sila": f"Grip {execution}"})
    return httpx.Response(200, json={"jobs": [job], "next_cursor": None})


@contextmanager
def restarted_server(list_jobs: Reply) -> Generator[Any]:
    """Yield the gripper feature of a server that follows its rig and opens no port."""

    async def reply(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/rigs/demo"):
            return httpx.Response(200, json=example(Rig))
        if request.url.path.endswith("/jobs"):
            return await list_jobs()
        raise httpx.ConnectError("nothing else is served")

    background = Background()
    server = SilaServer("pincette demo", "Test", "A test.", "0.1", "https://pincette.invalid")
    callers = Callers("http://supervisor", "demo", None, None, background)
    callers.supervisor = AsyncSupervisor("http://supervisor", transport=httpx.MockTransport(reply))
    recovery = ErrorRecovery(server, callers, background)
    gripper = Gripper(server, "demo", callers, background, recovery)
    pausing = Pausing(server, gripper, callers, background)
    server.set_feature_implementation(feature(MICROGRIPPER), gripper)
    server.set_feature_implementation(feature(PAUSE_CONTROLLER), pausing)
    background.begin(watch_rig(server, gripper, callers, pausing))
    try:
        yield gripper
    finally:
        background.close()


def published(queue: Queue[Any]) -> list[Any]:
    """Return everything that has been published so far."""
    return [queue.get_nowait() for _ in range(queue.qsize())]


def test_the_state_is_unknown_until_the_commands_of_the_earlier_server_are_known() -> None:
    execution, requested, listed = uuid4(), Event(), Event()

    async def list_jobs() -> httpx.Response:
        requested.set()
        await asyncio.to_thread(listed.wait)
        return jobs_of(execution)

    with restarted_server(list_jobs) as gripper:
        states, reasons = gripper._RigState_producer_queue, gripper._Reasons_producer_queue
        try:
            assert requested.wait(30.0)
            until(
                lambda: gripper.watch.status.state != "unknown", "the state of the rig was not read"
            )
            until(lambda: reasons.qsize() > 1, "the reason is not published")
            assert set(published(states)) == {"unknown"}
            assert published(reasons)[-1] != []
        finally:
            listed.set()
        until(lambda: states.qsize(), "the state is not published")
        assert execution in gripper.managers()["Grip"]
        assert published(states)[0] != "unknown"


def test_a_failed_listing_is_reported_as_the_reason_and_repeated() -> None:
    execution = uuid4()
    failed = httpx.Response(503, json={"title": "No store", "detail": "the disk is full"})
    replies = [jobs_of(execution), failed]

    async def list_jobs() -> httpx.Response:
        return replies.pop()

    with restarted_server(list_jobs) as gripper:
        until(lambda: execution in gripper.managers()["Grip"], "the state is still unknown")
        reasons = published(gripper._Reasons_producer_queue)
    assert any("the disk is full" in reason for row in reasons for reason in row)


def test_a_call_after_the_background_thread_has_closed_is_refused_at_once() -> None:
    background = Background()
    background.close()
    with pytest.raises(CommandError) as caught:
        background.call(asyncio.sleep(0.0))
    assert caught.value.identifier == "SupervisorUnreachable"
