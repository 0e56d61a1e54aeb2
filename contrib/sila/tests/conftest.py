"""Fixtures of the SiLA server tests: a rig for each module, a client for each test."""

from collections.abc import Generator
from contextlib import suppress
from typing import Any

import pytest
from sila2.framework import DefinedExecutionError

from contrib.support.sila import stock_client
from pincette.config.reading import laid_over
from tests.support.adapters import adapter_rig, ports_of_adapters, until
from tests.support.running import RunningRig


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Generator[RunningRig]:
    changes = laid_over(ports_of_adapters(), {"simulation": {"scripts": True}})
    with adapter_rig(tmp_path_factory.mktemp("sila"), changes, ["sila"]) as running:
        yield running


@pytest.fixture
def client(rig: RunningRig, cleared: None) -> Generator[Any]:  # noqa: ARG001
    with stock_client(rig) as found:
        yield found


@pytest.fixture
def cleared(rig: RunningRig) -> Generator[None]:
    """Release the part and clear the latch after a test, even if the test failed."""
    yield
    with stock_client(rig) as found, suppress(DefinedExecutionError):
        found.LockController.UnlockServer("cell 7")
    if (job := rig.view()["active_job"]) is not None:
        rig.post(f"/jobs/{job}/actions", {"type": "abort"})
    view = rig.view()
    if view["latch"]["state"] in ("frozen", "ramping", "latched"):
        until(lambda: rig.view()["latch"]["state"] == "latched", "the rig did not come to rest")
        rig.post("/rigs/demo/reset", {"acknowledge": True}).raise_for_status()
    until(lambda: rig.view()["active_job"] is None, "a job is left")
    assert rig.view()["part"] != "held"
