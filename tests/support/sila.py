"""Stock clients of SiLA 2, as a laboratory has them, and a rig with its SiLA server."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest
from sila2.client import SilaClient
from sila2.framework import DefinedExecutionError

from pincette.config.reading import laid_over
from tests.support.grips import SHORT
from tests.support.rigs import Tree, free_ports, paced_rig
from tests.support.running import RunningRig, running_rig

WAIT_S = 30.0
LOOK_S = 0.02


@contextmanager
def sila_rig(folder: Path, changes: Tree | None = None) -> Generator[RunningRig]:
    """A rig in lockstep at the pace of real time, and its SiLA server."""
    own: Tree = {"sila": {"port": free_ports(1)}, "simulation": {"scripts": True}}
    rig = paced_rig(laid_over(laid_over(SHORT, own), changes or {}))
    with running_rig(rig, folder) as running:
        running.fleet.start(["sila"])
        yield running


@contextmanager
def stock_client(rig: RunningRig, **details: Any) -> Generator[Any]:
    """The client of the package sila2, without code that was generated for this server."""
    details = details or {"insecure": True}
    with SilaClient(rig.rig.sila.host, rig.rig.sila.port, **details) as client:
        yield client


def responses(command: Any) -> Any:
    """Responses of an observable command, once it has ended; raises its error."""
    deadline = monotonic() + WAIT_S
    while not command.done:
        assert monotonic() < deadline, f"{command.status} at {command.progress}"
        sleep(LOOK_S)
    return command.get_responses()


def until(there: Any, what: str) -> None:
    """Wait until something is the case."""
    deadline = monotonic() + WAIT_S
    while not there():
        assert monotonic() < deadline, what
        sleep(LOOK_S)


def refusal(command: Any) -> DefinedExecutionError:
    """The defined execution error in which a command ends."""
    with pytest.raises(DefinedExecutionError) as caught:
        responses(command)
    return caught.value
