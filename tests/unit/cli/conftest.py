"""A supervisor with prepared replies in place of the one that the command line calls."""

from collections.abc import Callable
from typing import Any

import pytest

from pincette import client
from pincette.client import Supervisor
from tests.unit.client.desk import Desk

At = Callable[..., Desk]


@pytest.fixture
def at(monkeypatch: pytest.MonkeyPatch) -> At:
    """Serve prepared replies at the address that the command line uses."""

    def place(*answers: Any) -> Desk:
        supervisor = Desk(*answers)

        def reached(_url: str, **settings: Any) -> Supervisor:
            return supervisor.supervisor(0.0, settings.get("claim"))

        monkeypatch.setattr(client, "Supervisor", reached)
        return supervisor

    return place
