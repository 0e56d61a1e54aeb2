"""Stock clients of SiLA 2, as used in laboratories."""

from collections.abc import AsyncGenerator, Generator
from contextlib import AbstractContextManager, asynccontextmanager, contextmanager
from typing import Any

import pytest
from sila.client import Client, ClientConfig
from sila2.client import SilaClient
from sila2.framework import DefinedExecutionError

from pincette.config import RigFile
from tests.support.adapters import until
from tests.support.running import RunningRig


def stock_client(rig: RunningRig, **details: Any) -> AbstractContextManager[Any]:
    """Provide the client of the package sila2, without code generated for this server."""
    return stock_client_at(rig.rig, **details)


@contextmanager
def stock_client_at(rig: RigFile, **details: Any) -> Generator[Any]:
    """Provide the client of the package sila2 for a rig file."""
    details = details or {"insecure": True}
    with SilaClient(rig.sila.host, rig.sila.port, **details) as client:
        yield client


@asynccontextmanager
async def unitelabs(rig: RigFile) -> AsyncGenerator[Any]:
    """Provide the client of unitelabs for a server without TLS."""
    config = ClientConfig(hostname=rig.sila.host, port=rig.sila.port, tls=False)
    async with Client(config) as client:
        yield client


async def ended(execution: Any) -> Any:
    """Return the responses of an observable command of UniteLabs' client after its end."""
    async for _ in await execution.subscribe_status():
        pass
    return await execution.get_responses()


def responses(command: Any) -> Any:
    """Return the responses of an observable command after its end; raises its error."""
    until(lambda: command.done, f"{command.status} at {command.progress}")
    return command.get_responses()


def refusal(command: Any) -> DefinedExecutionError:
    """Return the defined execution error with which a command ends."""
    with pytest.raises(DefinedExecutionError) as caught:
        responses(command)
    return caught.value
