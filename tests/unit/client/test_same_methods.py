"""Both clients have the same methods, arguments and docstrings."""

import inspect
from collections.abc import Callable
from typing import Any

import pytest

from pincette import client

PAIRS = [
    (client.Supervisor, client.AsyncSupervisor),
    (client.RigHandle, client.AsyncRigHandle),
    (client.JobHandle, client.AsyncJobHandle),
    (client.SeriesHandle, client.AsyncSeriesHandle),
]
STREAMS = {"events", "live", "to_hold", "to_success", "to_release"}
KNOWN_WITHOUT_ASKING = {"patient", "within", "result"}


def public(kind: type) -> dict[str, Any]:
    return {name: member for name, member in vars(kind).items() if not name.startswith("_")}


def methods(members: dict[str, Any]) -> set[str]:
    return {name for name, member in members.items() if inspect.isfunction(member)}


def arguments(function: Callable[..., Any]) -> list[tuple[str, object, str]]:
    parameters = inspect.signature(function).parameters.values()
    return [(one.name, one.default, str(one.kind)) for one in parameters]


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_both_clients_have_the_same_methods(one: type, other: type) -> None:
    ours, theirs = public(one), public(other)
    assert ours
    assert methods(ours) == methods(theirs)
    assert set(theirs) <= set(ours)
    for name, member in ours.items():
        assert member.__doc__, name
        if name not in theirs:
            continue  # an attribute of the asynchronous object
        assert inspect.getdoc(member) == inspect.getdoc(theirs[name]), name
        if inspect.isfunction(member):
            assert arguments(member) == arguments(theirs[name]), name
            waits = name not in STREAMS | KNOWN_WITHOUT_ASKING
            assert inspect.iscoroutinefunction(theirs[name]) == waits, name
