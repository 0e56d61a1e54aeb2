"""RunEngine whose documents are validated, with a rig as its device."""

import asyncio
from collections.abc import Generator
from time import monotonic
from typing import Any, cast

import bluesky.plan_stubs
import bluesky.preprocessors
import bluesky.simulators
import event_model
import pytest
from bluesky.run_engine import RunEngine
from bluesky.utils import FailedStatus
from ophyd_async.core import init_devices

from pincette_bluesky import Gripper
from tests.support.adapters import until
from tests.support.running import RunningRig

# The type annotations of these packages are incomplete.
bps = cast("Any", bluesky.plan_stubs)
bpp = cast("Any", bluesky.preprocessors)
check_limits = cast("Any", bluesky.simulators).check_limits
SCHEMAS = cast("Any", event_model).schema_validators


def new_engine() -> Any:
    """Return an engine that does not handle Ctrl-C, so that the test can."""
    return RunEngine({}, context_managers=[])


def ended(engine: Any) -> None:
    """Stop the loop of an engine, and close it."""
    engine.loop.call_soon_threadsafe(engine.loop.stop)
    until(lambda: not engine.loop.is_running(), "the event loop of the engine still runs")
    engine.loop.close()


def subscribed(engine: Any, seen: list[tuple[str, Any]]) -> int:
    """Validate and collect every document in ``seen``; return the token of the subscription."""

    def validate(name: str, document: Any) -> None:
        SCHEMAS[event_model.DocumentNames[name]].validate(document)
        seen.append((name, document))

    return engine.subscribe(validate)


def connected(url: str, rig: str | None = None, timeout_s: float = 10.0, **shown: Any) -> Gripper:
    """Provide a device that has found its rig."""
    with init_devices(timeout=timeout_s):
        gripper = Gripper(url, rig, **shown)
    return gripper  # noqa: RET504 - it is named and connected as the block ends


def closed(engine: Any, device: Gripper) -> None:
    """Close the connections of a device."""
    asyncio.run_coroutine_threadsafe(device.close(), engine.loop).result(5.0)


def until_moving(rig: RunningRig) -> Generator[Any, Any, None]:
    """Return a plan that waits for a running motion."""
    deadline = monotonic() + 60.0
    while rig.phase() != "approach":
        assert monotonic() < deadline, "nothing moves"
        yield from bps.sleep(0.02)


def of(documents: list[tuple[str, Any]], kind: str) -> list[Any]:
    """Return the documents of one kind."""
    return [document for name, document in documents if name == kind]


def failure(engine: Any, plan: Any) -> BaseException:
    """Return the device's error that caused the engine's errors in a plan."""
    with pytest.raises(FailedStatus) as caught:
        engine(plan)
    error: BaseException = caught.value
    while isinstance(error, FailedStatus):
        assert error.__cause__ is not None
        error = error.__cause__
    return error
